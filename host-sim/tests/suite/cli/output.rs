//! Files that the program writes: nothing is destroyed, and what cannot be written is said before the work.

use super::harness::{Bench, USAGE};

const FAILURE: i32 = 1;

/// What makes a short record at once.
const MAKE: [&str; 7] = ["simulate", "--model", "lf", "--step", "1e-4", "--duration", "0.2"];

#[test]
fn nothing_is_written_over_what_is_read() {
    let bench = Bench::new();
    bench.noisy_record();
    let record = bench.read("record.csv");
    for name in ["trace.csv", "report.html", "rig.csv"] {
        bench.write(name, &record);
    }
    bench.write("rig.toml", "name = \"mine\"\n");
    for (arguments, file) in [
        (&["identify", "trace.csv", "--out", "."][..], "trace.csv"),
        (&["identify", "trace.csv@0..0.5", "--out", "."], "trace.csv"),
        (&["diagnose", "record.csv", "--holdout", "trace.csv", "--out", "."], "trace.csv"),
        (&["check", "report.html", "--out", "."], "report.html"),
        (&["import", "record.csv", "-o", "./record.csv"], "record.csv"),
        (&["import", "record.csv", "--out", "."], "record.csv"),
        (&["simulate", "--command", "record.csv", "-o", "record.csv"], "record.csv"),
        (&["identify", "record.csv", "--trace", "record.csv"], "record.csv"),
        (&["calibrate", "record.csv", "--rig", "rig.toml", "--out", "."], "rig.toml"),
        (&["diagnose", "record.csv", "--rig", "rig.toml", "--out", "."], "rig.toml"),
        (&["diagnose", "record.csv", "--holdout", "rig.csv", "--prediction", "rig.csv"], "rig.csv"),
    ] {
        bench.run(arguments).refused(USAGE, &[file, "would be written over", "which is read"]);
    }
    let twice =
        ["diagnose", "rig.csv", "--holdout", "rig.csv", "--prediction", "new.csv", "--trace", "./new.csv"];
    bench.run(&twice).refused(USAGE, &["./new.csv would be written twice"]);
    assert_eq!(bench.files(), ["record.csv", "report.html", "rig.csv", "rig.toml", "trace.csv"]);
    assert_eq!(bench.read("record.csv"), record);
    // A built-in rig and a built-in command are no files.
    bench.run(&[&MAKE[..], &["--rig", "eha", "-o", "eha"]].concat()).done();
    bench.run(&[&MAKE[..], &["--command", "chirp", "-o", "chirp"]].concat()).done();
    bench.run(&[&MAKE[..], &["--command", "chirp", "-o", "chirp"]].concat()).done();
}

#[test]
fn a_dash_is_standard_output_where_that_is_free() {
    let bench = Bench::new();
    let whole = bench.run(&MAKE).done().stdout;
    for more in [&["-o", "-"][..], &["-o", "-", "--out", "results"]] {
        assert_eq!(bench.run(&[&MAKE[..], more].concat()).done().stdout, whole, "{more:?}");
    }
    assert!(bench.run(&[&MAKE[..], &["-o", "-", "--json"]].concat()).done().json()["columns"].is_object());
    bench.write("record.csv", &whole);
    assert_eq!(bench.run(&["import", "record.csv", "-o", "-"]).done().stdout.matches('\n').count(), 203);
    for arguments in [
        &["identify", "record.csv", "--trace", "-"][..],
        &["diagnose", "record.csv", "--trace", "-"],
        &["diagnose", "record.csv", "--holdout", "record.csv", "--prediction", "-"],
        &["identify", "record.csv", "--out", "-"],
    ] {
        bench.run(arguments).refused(USAGE, &["standard output has the result"]);
    }
    assert_eq!(bench.files(), ["record.csv"]);
}

#[test]
fn what_cannot_be_written_is_said_before_the_work() {
    let bench = Bench::new();
    bench.write("file", "kept");
    // There is no record: it would be said first if it were looked at first.
    for (arguments, path) in [
        (
            &["identify", "none.csv", "--out", "file"][..],
            "file/identify.json: file is a file, expected a directory",
        ),
        (&["check", "none.csv", "--out", "file/deep"], "file/deep/check.json: file is a file"),
        (&["calibrate", "none.csv", "--out", "file"], "file/calibrate.json: file is a file"),
        (&["diagnose", "none.csv", "--out", "file"], "file/rig.toml: file is a file"),
        (&["diagnose", "none.csv", "--trace", "."], "write .: it is a directory, expected a file"),
        (&["import", "none.csv", "-o", "file/record.csv"], "file/record.csv: file is a file"),
        (&["simulate", "-o", "file/record.csv"], "file/record.csv: file is a file"),
        (&["demo", "--out", "file"], "file/rig.toml: file is a file"),
        (&["man", "--out", "file"], "file/host-sim.1: file is a file"),
        (&["reproduce", "--out", "file"], "file/reproduce.json: file is a file"),
    ] {
        bench.run(arguments).refused(FAILURE, &["cannot write ", path]);
    }
    assert_eq!((bench.files(), bench.read("file")), (vec!["file".to_owned()], "kept".to_owned()));
    // Neither does a bad record leave a directory that was looked at.
    bench.run(&["identify", "file", "--out", "new/deep"]).refused(super::harness::BAD_DATA, &["file"]);
    assert_eq!(bench.files(), ["file"]);
}

#[test]
fn a_read_only_file_is_not_replaced() {
    let bench = Bench::new();
    let set_read_only = |name: &str, is: bool| {
        let mut rights = std::fs::metadata(bench.path(name)).expect("it is there").permissions();
        rights.set_readonly(is);
        std::fs::set_permissions(bench.path(name), rights).expect("the test's own file");
    };
    std::fs::create_dir(bench.path("results")).expect("a directory");
    for name in ["kept.csv", "results/identify.json"] {
        bench.write(name, "kept");
        set_read_only(name, true);
    }
    // There is no record: it would be said first if it were looked at first.
    for (arguments, path) in [
        (&["simulate", "-o", "kept.csv"][..], "kept.csv"),
        (&["import", "none.csv", "-o", "kept.csv"], "kept.csv"),
        (&["identify", "none.csv", "--trace", "kept.csv"], "kept.csv"),
        (&["identify", "none.csv", "--out", "results"], "results/identify.json"),
    ] {
        let said = format!("cannot write {path}: it is read-only");
        bench.run(arguments).refused(FAILURE, &[&said]);
        assert_eq!(bench.read(path), "kept");
    }
    // What may be written to is replaced, and what is read-only is read.
    set_read_only("kept.csv", false);
    bench.run(&[&MAKE[..], &["-o", "kept.csv"]].concat()).done();
    assert_ne!(bench.read("kept.csv"), "kept");
    set_read_only("kept.csv", true);
    bench.run(&["import", "kept.csv", "-o", "new.csv"]).done();
}

#[cfg(target_os = "linux")]
mod linux {
    use super::*;
    use std::os::unix::fs::{FileTypeExt, symlink};
    use std::process::Command;

    #[test]
    fn a_directory_that_takes_no_file_is_named_as_the_user_named_it() {
        let bench = Bench::new();
        for verb in ["identify", "diagnose"] {
            let run = bench
                .run(&[verb, "none.csv", "--out", "/proc/new"])
                .refused(FAILURE, &["cannot write /proc/new/"]);
            assert!(!run.stderr.contains(".tmp"), "{}", run.stderr);
        }
        bench
            .run(&["demo", "--out", "/proc/new"])
            .refused(FAILURE, &["/proc/new/rig.toml", "no file can be made in /proc"]);
    }

    #[test]
    fn a_result_that_could_not_be_written_in_the_end_is_printed() {
        let bench = Bench::new();
        bench.noisy_record();
        for (verb, part) in [("identify", "| bkl "), ("diagnose", "verdict: adequate")] {
            let run = bench.run(&[verb, "record.csv", "--trace", "/dev/full"]);
            assert_eq!(run.code, Some(FAILURE), "{}", run.stderr);
            assert!(run.stdout.contains(part), "{}", run.stdout);
            assert!(run.stderr.contains("cannot write /dev/full: No space left"), "{}", run.stderr);
        }
        let run = bench.run(&["identify", "record.csv", "--trace", "/dev/full", "--json"]);
        assert_eq!((run.code, &run.json()["schema"]), (Some(FAILURE), &1.into()));
    }

    #[test]
    fn devices_pipes_and_links_stay_what_they_are() {
        let bench = Bench::new();
        bench.noisy_record();
        symlink("/dev/null", bench.path("null")).expect("a link");
        symlink("target.csv", bench.path("link.csv")).expect("a link");
        assert!(Command::new("mkfifo").arg(bench.path("pipe")).status().expect("mkfifo").success());
        bench.write("target.csv", "old");
        let reader = std::thread::spawn({
            let pipe = bench.path("pipe");
            move || std::fs::read_to_string(pipe).expect("a text")
        });
        bench.run(&["import", "record.csv", "-o", "pipe"]).done();
        bench.run(&["import", "record.csv", "-o", "link.csv"]).done();
        bench.run(&["import", "record.csv", "-o", "null"]).done();
        bench.run(&["identify", "record.csv", "--trace", "null"]).done();
        assert_eq!(reader.join().expect("a reader"), bench.read("target.csv"));
        let kind = |name: &str| std::fs::symlink_metadata(bench.path(name)).expect("it is there").file_type();
        assert!(kind("pipe").is_fifo() && kind("null").is_symlink() && kind("link.csv").is_symlink());
        assert!(std::fs::metadata("/dev/null").expect("it is there").file_type().is_char_device());
        // Standard output that goes to a file with something in it already.
        bench.write("log", "before\n");
        let log = std::fs::OpenOptions::new().append(true).open(bench.path("log")).expect("a file");
        let ended = bench.command(&["import", "record.csv", "-o", "/dev/stdout"]).stdout(log).status();
        assert!(ended.expect("the program starts").success());
        assert_eq!(bench.read("log"), format!("before\n{}", bench.read("target.csv")));
    }
}

#[test]
fn a_record_is_written_as_its_name_ends() {
    let bench = Bench::new();
    bench.noisy_record();
    bench.run(&["import", "record.csv", "-o", "record.parquet"]).done();
    assert!(std::fs::read(bench.path("record.parquet")).expect("a file").starts_with(b"PAR1"));
    bench.run(&["import", "record.parquet", "-o", "again.csv"]).done();
    let rows = |name: &str| {
        let text = bench.read(name);
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(rows("again.csv"), rows("record.csv"));
}

#[test]
fn the_rig_of_a_diagnosis_has_no_value_of_what_the_records_say_nothing_about() {
    let bench = Bench::new();
    let options = ["--model", "lf", "--command", "sine", "--set", "fdj=800", "--channels", "lvdt_m"];
    bench.simulate("noisy.csv", &[&options[..], &["--set", "bkl=2e-4", "--noise", "lvdt_m=1e-4"]].concat());
    let range = |name: &str, lower: f64, upper: f64| {
        format!("[[fault]]\nname = \"{name}\"\nlower = {lower:?}\nupper = {upper:?}\n")
    };
    // Noise of 0.1 mm leaves the friction open by some 10 N.
    bench.write("narrow.toml", &[range("bkl", 0.0, 1.5e-3), range("fdj", 797.0, 803.0)].concat());
    let written = |rig: &str| {
        let arguments = ["diagnose", "noisy.csv", "--rig", rig, "--out", "found"];
        let said = bench.run(&arguments).done().stdout;
        let text = bench.read("found/rig.toml");
        let has = |name: &str| text.lines().any(|line| line.starts_with(&format!("{name} = ")));
        assert!(has("bkl"), "{text}");
        let is_left_out = text.contains("# fdj as it was: the records say nothing about it");
        assert_eq!(is_left_out, said.contains("these records say nothing about fdj"), "{said}");
        assert_eq!(is_left_out, !has("fdj"), "{text}");
        is_left_out
    };
    assert!(written("narrow.toml") && !written("eha"));
}
