//! A folder of parts may hold what is not ours: only the job's own files are ever deleted, and the folder only when nothing else is in it.

mod common;

use common::{folder, names, run, succeed, text};

const RUN: &[&str] = &["simulate", "tiny.toml", "--preset", "preview", "--quiet", "-o", "t.pwt"];

#[test]
fn files_of_others_stay_in_a_folder_of_parts() {
    let folder = folder();
    let dir = folder.path();
    let parts = dir.join("t.pwt.parts");
    std::fs::create_dir_all(parts.join("thesis")).unwrap();
    // Names that are nearly those of parts, a folder, a hidden file.
    let mine = ["notes.txt", "shard.pwp", "shard_x.pwp", "shard000001.pwp.bak", ".hidden", "thesis/chapter.txt"];
    for name in mine {
        std::fs::write(parts.join(name), name).unwrap();
    }
    let kept = || mine.iter().all(|name| std::fs::read_to_string(parts.join(name)).is_ok_and(|t| t == *name));
    let before = names(&parts);
    for more in [&[][..], &["--fresh"], &["--resume"]] {
        succeed(dir, &[RUN, more].concat());
        assert!(kept(), "{more:?}: {:?}", names(&parts));
        assert_eq!(names(&parts), before, "{more:?}: its own files are gone, and nothing else");
    }
    // With a damaged part of its own beside them.
    std::fs::write(parts.join("shard000000.pwp"), "no part").unwrap();
    let again = run(dir, &[RUN, &["--fresh"]].concat());
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert!(kept());
}
