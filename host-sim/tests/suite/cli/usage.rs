//! Wrong usage and configuration: exit code 2, and what was meant.

use super::harness::{Bench, USAGE};

#[test]
fn a_wrong_name_gets_a_suggestion() {
    let bench = Bench::new();
    bench.noisy_record();
    for (arguments, parts) in [
        (&["identfy", "record.csv"][..], &["identify"][..]),
        (
            &["identify", "record.csv", "--rig", "ehb"],
            &[
                "unknown rig `ehb`, expected a rig file or one of the built-in rigs eha,",
                "; did you mean `eha`?\n",
            ],
        ),
        (&["identify", "record.csv", "--rig", "servo-hydraulics"], &["did you mean `servo-hydraulic`"]),
        (&["identify", "record.csv", "--bounds", "bkk=0..1"], &["`bkk`", "did you mean `bkl`"]),
        (&["identify", "record.csv", "--seeed", "1"], &["--seed"]),
        (&["simulate", "--set", "blk=3"], &["`blk`; did you mean `bkl`"]),
        (&["identify", "record.csv", "--truth", "mass=3"], &["unknown parameter `mass`\n"]),
        (&["simulate", "--set", "GMM=1"], &["`GMM`", "did you mean `GM`"]),
        (&["simulate", "--command", "chrip"], &["`chrip`", "did you mean `chirp`"]),
        (&["simulate", "--effect", "spool-overlop=1e-6"], &["did you mean `spool-overlap`"]),
        (&["simulate", "--noise", "lvdt=1e-6"], &["did you mean `lvdt_m`"]),
        (&["simulate", "--channels", "ram"], &["did you mean `ram_m`"]),
        (&["rigs", "force-axes"], &["did you mean `force-axis`"]),
    ] {
        bench.run(arguments).refused(USAGE, parts);
    }
    assert_eq!(bench.files(), ["record.csv"]);
}

#[test]
fn a_wrong_value_is_named_with_what_was_expected() {
    let bench = Bench::new();
    bench.noisy_record();
    for (arguments, parts) in [
        (&["identify"][..], &["<REC>"][..]),
        (&["identify", "record.csv", "--bounds", "bkl=5..1"], &["5 to 1 of `bkl`", "lower < upper"]),
        (&["identify", "record.csv", "--bounds", "bkl=0..nan"], &["`bkl`"]),
        (&["identify", "record.csv", "--bounds", "bkl=0"], &["NAME=LOW..HIGH"]),
        (&["identify", "record.csv", "--truth", "bkl=2e-4,bkl=3e-4"], &["`bkl` is given twice"]),
        (&["identify", "record.csv", "--truth", "bkl=2"], &["`bkl` = 2: expected 0 to", " m\n"]),
        (&["identify", "record.csv", "--population", "3"], &["4..=64"]),
        (&["identify", "record.csv", "--budget", "0"], &["--budget"]),
        (&["identify", "record.csv", "--threads", "0"], &["--threads"]),
        (&["identify", "record.csv", "--rig", "none.toml"], &["none.toml", "cannot read", "servo-hydraulic"]),
        (&["calibrate", "record.csv", "--rig", "eha"], &["free parameters", "--bounds"]),
        (&["simulate", "--set", "fdj=1e9"], &["`fdj`", "expected 0 to"]),
        (&["simulate", "--set", "fdj=nan"], &["`fdj`"]),
        (&["simulate", "--set", "fdj"], &["NAME=VALUE"]),
        (
            &["simulate", "--effect", "step-load=1,2,3"],
            &["3 values, expected at most", "step_load,step_load_time"],
        ),
        (&["simulate", "--dropout", "1.5"], &["--dropout 1.5"]),
        (&["simulate", "--noise", "lvdt_m=-1"], &["lvdt_m=-1"]),
        (&["simulate", "--noise", "command_m=1e-6"], &["not a measured channel"]),
        (&["simulate", "--load", "square:1"], &["constant:N"]),
        (&["simulate", "--load", "constant:nan"], &["load_N"]),
        (&["simulate", "--load", "constant:5:6"], &["constant:N"]),
        (&["simulate", "--effect", "sensor-delay=0.05"], &["`sensor_delay` = 0.05", "at most 0.031 s"]),
        (&["simulate", "--command", "record.csv", "--duration", "2"], &["--duration", "record.csv is flown"]),
        (&["rigs", "--out", "x"], &["--out x", "writes no files"]),
        (&["effects", "--out", "x"], &["--out x"]),
        (&["--out", "x", "commands"], &["--out x"]),
        (&["import", "record.csv", "-o", "x.mat"], &["x.mat", ".csv or .parquet"]),
        (&["identify", "record.csv", "--trace", "x.txt"], &["x.txt", ".csv or .parquet"]),
        (
            &["diagnose", "record.csv", "--holdout", "record.csv", "--prediction", "x.xlsx"],
            &["x.xlsx", ".csv or .parquet"],
        ),
        (&["demo", "--rig", "eha"], &["--rig eha: `demo` is about its own rig"]),
        (&["effects", "--rig", "nope"], &["--rig nope: this verb is about no rig, expected no such option"]),
        (&["--rig", "eha", "commands"], &["this verb is about no rig"]),
        (&["budget", "--rig", "nope"], &["--rig nope: this verb is about no rig"]),
        (&["import", "record.csv", "--rig", "nope", "-o", "x.csv"], &["this verb is about no rig"]),
        (
            &["rigs", "eha", "--rig", "force-axis"],
            &["--rig force-axis: this verb takes the rig as an argument"],
        ),
        (&["reproduce", "--rig", "force-axis"], &["`force-axis` is another actuator", "drive force"]),
        (
            &["reproduce", "--rig", "servo-hydraulic"],
            &[
                "`servo-hydraulic` is another actuator",
                "valve first-order",
                "expected `eha` or what a diagnosis",
            ],
        ),
        (&["hil", "record.csv", "--seconds", "2"], &["--seconds"]),
        (&["hil", "--baud", "9600"], &["--port"]),
        (&["hil", "--port", "/dev/null", "--machine", "mps2-an386"], &["--machine"]),
        (&["simulate", "--duration", "0.01"], &["11 samples", "at least 50"]),
        (&["simulate", "--duration", "1e12"], &["--duration", "at most"]),
        (&["simulate", "--duration=-1"], &["--duration -1"]),
        (&["simulate", "--dropout", "-0.1"], &["--dropout -0.1: expected 0 to below 1"]),
        (&["simulate", "--step", "-1e-6"], &["--step -0.000001: expected a positive number"]),
        (&["simulate", "--seed", "-1"], &["invalid value '-1' for '--seed <SEED>'"]),
        (&["check", "record.csv", "--rate", "-1000"], &["--rate -1000: expected a positive number"]),
        (&["diagnose", "record.csv", "--effort", "-5"], &["'-5' for '--effort <S>': expected more than 0"]),
        (&["identify", "record.csv", "--population", "-3"], &["-3", "4..=64"]),
        (&["hil", "--seconds", "-1"], &["'-1' for '--seconds <SECONDS>': expected 0.1 to 3600"]),
        (&["hil", "--damage", "-0.1"], &["expected 0 to 1"]),
        (&["simulate", "--step", "0"], &["--step 0"]),
        (&["simulate", "--step", "1"], &["--step 1: expected at most 0.0001 s"]),
        (&["simulate", "--step", "1.01e-4"], &["expected at most 0.0001 s"]),
        (
            &["simulate", "--step", "1e-12"],
            &["--step 1e-12: expected at least 1e-9 s for 1001 samples every 0.001 s"],
        ),
        (
            &["simulate", "--step", "1e-8", "--duration", "1000"],
            &["expected at least 1.00000", "e-7 s for 1000001 samples"],
        ),
        (&["simulate", "--amplitude", "nan"], &["command_m"]),
        (&["simulate", "--amplitude", "0"], &["lvdt_m", "same value"]),
        (&["simulate", "--rig", "force-axis"], &["drive_N"]),
        (&["import", "record.csv", "--columns", "lvdt_m"], &["lvdt_m"]),
        (
            &["diagnose", "record.csv@..0.6", "--holdout", "record.csv@0.5.."],
            &[
                "record.csv@..0.6 is fitted and has samples in common with record.csv@0.5.., which is held out",
            ],
        ),
        (
            &["diagnose", "record.csv", "--holdout", "./record.csv"],
            &["in common with ./record.csv, which is held out"],
        ),
    ] {
        bench.run(arguments).refused(USAGE, parts);
    }
    assert_eq!(bench.files(), ["record.csv"]);
}

#[test]
fn a_wrong_rig_file_is_named_with_its_entry() {
    let bench = Bench::new();
    bench.noisy_record();
    for (text, parts) in [
        ("[parameters]\nGMM = 1.0", &["rig.toml", "did you mean `GM`"][..]),
        ("[parameters]\nfdj = -1.0", &["rig.toml", "`fdj` = -1"]),
        ("base = \"ehb\"", &["rig.toml", "did you mean `eha`"]),
        ("[[effect]]\nname = \"sensor-offst\"", &["rig.toml", "did you mean `sensor-offset`"]),
        ("name = ", &["rig.toml", "line 1"]),
        ("fault = []", &["0 free parameters"]),
    ] {
        bench.write("rig.toml", text);
        bench.run(&["identify", "record.csv", "--rig", "rig.toml"]).refused(USAGE, parts);
    }
}

#[test]
fn the_help_states_the_exit_codes() {
    let bench = Bench::new();
    let help = bench.run(&["--help"]).done().stdout;
    for part in ["0 done", "1 failure", "2 usage", "3 bad input data", "4 no convergence"] {
        assert!(help.contains(part), "{help}");
    }
    assert!(bench.run(&["--version"]).done().stdout.contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_command_takes_the_options_that_shape_it() {
    let bench = Bench::new();
    let short = ["simulate", "--model", "lf", "--step", "1e-4", "--duration", "0.1", "-o", "record.csv"];
    for (arguments, part) in [
        (
            &["--command", "mixed", "--amplitude", "3"][..],
            "--amplitude: the command `mixed` has no amplitude, expected none",
        ),
        (
            &["--command", "step", "--frequency", "5"],
            "the command `step` has no frequency, expected --amplitude",
        ),
        (&["--command", "ramp", "--frequency", "3"], "the command `ramp` has no frequency"),
        (
            &["--command", "sine", "--sweep", "5"],
            "the command `sine` has no sweep, expected --amplitude, --frequency",
        ),
        (&["--command", "sine", "--end-frequency", "3"], "the command `sine` has no end frequency"),
    ] {
        bench.run(&[&short[..], arguments].concat()).refused(USAGE, &[part]);
    }
    assert!(bench.files().is_empty());
    for (arguments, words) in [
        (&["--command", "step", "--amplitude", "0.002"][..], "command step, amplitude 0.002\n"),
        (
            &["--command", "chirp", "--sweep", "2", "--end-frequency", "3"],
            "command chirp, amplitude 0.01, frequency 0.1 Hz, end frequency 3 Hz, sweep 2 s\n",
        ),
    ] {
        bench.run(&[&short[..], arguments].concat()).done();
        assert!(bench.read("record.csv").contains(words), "{}", bench.read("record.csv"));
    }
}

#[test]
fn a_record_that_no_option_makes_is_refused_without_options_of_other_verbs() {
    let bench = Bench::new();
    for arguments in [&["--command", "sine", "--amplitude", "10"][..], &["--load", "constant:1e12"]] {
        let run = bench.run(&[&["simulate", "--model", "lf", "--step", "1e-4"][..], arguments].concat());
        let run = run.refused(USAGE, &["found a magnitude of"]);
        assert!(!run.stderr.contains("--columns"), "{}", run.stderr);
    }
}
