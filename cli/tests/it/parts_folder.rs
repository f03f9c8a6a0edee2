//! A folder of parts may hold what is not ours: a run leaves all of it, and refuses a folder that holds
//! nothing of its own.

use crate::common::{folder, names, run, text};

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
        let output = run(dir, &[RUN, more].concat());
        let err = text(&output.stderr);
        assert_eq!((output.status.code(), err.lines().count()), (Some(2), 1), "{more:?}: {err}");
        assert!(err.contains("t.pwt.parts") && err.contains("something else"), "{err}");
        assert!(kept(), "{more:?}: {:?}", names(&parts));
        assert_eq!(names(&parts), before, "{more:?}");
    }
}
