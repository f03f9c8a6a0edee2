//! Results have the same bits on 1, 3 and 64 threads, many more than there are cores, shards or tiles.

use crate::common::{ANY_FIT, folder, succeed, write_cloth};

const THREADS: [&str; 3] = ["1", "3", "64"];

/// Runs a command on each number of threads; its outputs, by their endings, are the same.
fn same(command: &[&str], endings: &[&str]) {
    let folder = folder();
    let dir = folder.path();
    if command.contains(&"cloth.pwc") {
        write_cloth(dir);
    }
    let [one, others @ ..] = THREADS.map(|threads| {
        let output = format!("on{threads}.{}", endings[0]);
        succeed(dir, &[command, &["--threads", threads, "--quiet", "-o", &output]].concat());
        endings.iter().map(|e| std::fs::read(dir.join(format!("on{threads}.{e}"))).unwrap()).collect::<Vec<_>>()
    });
    assert!(one.iter().all(|bytes| bytes.len() > 1000));
    for (other, threads) in others.iter().zip(&THREADS[1..]) {
        assert!(one == *other, "{command:?}: 1 and {threads} threads differ");
    }
}

#[test]
#[ignore = "slow: 5 s: tables do not depend on threads"]
fn tables_do_not_depend_on_threads() {
    same(&["simulate", "tiny.toml", "--preset", "preview"], &["pwt"]);
}

#[test]
#[ignore = "slow: 15 s: models do not depend on threads"]
fn models_do_not_depend_on_threads() {
    same(&[&["build", "tiny.toml", "--preset", "preview", "--keep-table"], ANY_FIT].concat(), &["pwm", "pwt"]);
}

#[test]
#[ignore = "slow: 10 s: pictures do not depend on threads"]
fn pictures_do_not_depend_on_threads() {
    same(&["render", "cloth.pwc", "--width", "72", "--height", "40", "--samples", "4"], &["png", "exr"]);
}
