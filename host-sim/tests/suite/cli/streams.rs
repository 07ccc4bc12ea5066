//! Results on stdout, log on stderr, and nothing else.

use super::harness::{BAD_DATA, Bench, with_cells};
use std::io::{Read as _, Write as _};
use std::process::Stdio;

#[test]
fn quiet_silences_the_log_and_changes_no_result() {
    let bench = Bench::new();
    bench.simulate("record.csv", &["--model", "lf", "--dropout", "0.02"]);
    let loud = bench.run(&["identify", "record.csv", "--out", "."]).done();
    let quiet = bench.run(&["identify", "record.csv", "--out", ".", "--quiet"]).done();
    assert!(loud.stderr.contains("samples are missing"), "{}", loud.stderr);
    assert_eq!(quiet.stderr, "");
    assert!(quiet.stdout.contains("samples are missing"), "{}", quiet.stdout);
    let table = |text: &str| text.lines().filter(|line| line.starts_with('|')).map(str::to_owned).collect();
    let (loud, quiet): (Vec<String>, Vec<String>) = (table(&loud.stdout), table(&quiet.stdout));
    assert_eq!(loud, quiet);
}

#[test]
fn no_bar_is_drawn_where_there_is_no_terminal() {
    let bench = Bench::new();
    bench.noisy_record();
    let run = bench.run(&["identify", "record.csv"]).done();
    assert_eq!(run.stderr, "");
    assert!(!run.stdout.contains('\u{1b}'), "{}", run.stdout);
    assert!(run.stdout.contains("seed 1") && run.stdout.contains("rig eha"), "{}", run.stdout);
}

#[test]
fn a_record_on_stdout_is_the_record_and_nothing_else() {
    let bench = Bench::new();
    let arguments = ["simulate", "--model", "lf", "--step", "1e-5"];
    let run = bench.run(&arguments).done();
    assert_eq!(run.stderr, "");
    bench.run(&[&arguments[..], &["-o", "record.csv"]].concat()).done();
    assert_eq!(run.stdout, bench.read("record.csv"));
}

#[test]
fn a_closed_pipe_ends_the_program_quietly() {
    let bench = Bench::new();
    // Far more than a pipe holds.
    for arguments in [
        &["simulate", "--model", "lf", "--duration", "3", "--step", "1e-4"][..],
        &["simulate", "--model", "lf", "--duration", "3", "--step", "1e-4", "--json"],
    ] {
        let mut child = bench
            .command(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut first = [0];
        let mut stdout = child.stdout.take().expect("a pipe");
        stdout.read_exact(&mut first).expect("a byte");
        drop(stdout);
        let output = child.wait_with_output().expect("the program ends");
        assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{arguments:?}");
        assert!(output.status.success(), "{arguments:?}: {:?}", output.status);
    }
}

/// The lines of a record without its comments.
fn rows(text: &str) -> Vec<&str> {
    text.lines().filter(|line| !line.starts_with('#')).collect()
}

#[test]
fn a_record_may_come_on_stdin() {
    let bench = Bench::new();
    bench.noisy_record();
    let run = |name: &str| {
        let input = std::fs::File::open(bench.path(name)).expect("a file");
        let output = bench.command(&["import", "-"]).stdin(input).output().expect("the program starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (code, found, _) = run("record.csv");
    assert_eq!((code, rows(&found)), (Some(0), rows(&bench.read("record.csv"))));
    bench.write("bad.csv", "t_s,command_m,lvdt_m\n0,1,x\n");
    let (code, found, error) = run("bad.csv");
    assert_eq!((code, found.as_str()), (Some(3), ""));
    assert!(error.contains("stdin:2: column `lvdt_m` (3)"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_record_may_come_through_a_pipe() {
    let bench = Bench::new();
    bench.noisy_record();
    assert!(std::process::Command::new("mkfifo").arg(bench.path("pipe")).status().expect("mkfifo").success());
    let bare = with_cells(&bench.read("record.csv"), "lvdt_m", |_, cell| cell.to_owned());
    bench.write("bare.csv", &bare);
    let piped = bench.command(&["import", "/dev/stdin"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut piped = piped.expect("the program starts");
    piped.stdin.take().expect("a pipe").write_all(bare.as_bytes()).expect("it reads");
    let output = piped.wait_with_output().expect("the program ends");
    assert_eq!(rows(&String::from_utf8_lossy(&output.stdout)), rows(&bench.read("record.csv")));
    bench.write("bad.csv", "# of a logger\nt_s,command_m,lvdt_m\n0,1,x\n");
    let through = |name: &str| {
        let writer = std::thread::spawn({
            let (file, pipe) = (bench.path(name), bench.path("pipe"));
            move || std::fs::copy(file, pipe)
        });
        let run = bench.run(&["import", "pipe"]);
        // One that goes away before it has everything breaks the pipe.
        let _ = writer.join().expect("a writer");
        run
    };
    for name in ["record.csv", "bare.csv"] {
        assert_eq!(rows(&through(name).done().stdout), rows(&bench.read("record.csv")), "{name}");
    }
    through("bad.csv").refused(BAD_DATA, &["pipe:3: column `lvdt_m` (3)"]);
}
