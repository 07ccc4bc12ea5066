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
        (&["identify", "record.csv", "--truth", "bkl=2"], &["`bkl` = 2: expected 0 to", " m\n"]),
        (&["identify", "record.csv", "--population", "3"], &["4..=64"]),
        (&["identify", "record.csv", "--budget", "0"], &["--budget"]),
        (&["identify", "record.csv", "--threads", "0"], &["--threads"]),
        (&["identify", "record.csv", "--rig", "none.toml"], &["none.toml", "cannot read", "servo-hydraulic"]),
        (&["calibrate", "record.csv", "--rig", "eha"], &["free parameters", "--bounds"]),
        (&["simulate", "--set", "fdj=1e9"], &["`fdj`", "expected 0 to"]),
        (&["simulate", "--set", "fdj=nan"], &["`fdj`"]),
        (&["simulate", "--set", "fdj"], &["NAME=VALUE"]),
        (&["simulate", "--effect", "step-load=100"], &["expected values of step_load"]),
        (&["simulate", "--dropout", "1.5"], &["--dropout 1.5"]),
        (&["simulate", "--noise", "lvdt_m=-1"], &["lvdt_m=-1"]),
        (&["simulate", "--noise", "command_m=1e-6"], &["not a measured channel"]),
        (&["simulate", "--load", "square:1"], &["constant:N"]),
        (&["simulate", "--load", "constant:nan"], &["load_N"]),
        (&["simulate", "--load", "constant:5:6"], &["constant:N"]),
        (&["simulate", "--effect", "sensor-delay=0.05"], &["`sensor_delay` = 0.05", "at most 0.031 s"]),
        (&["simulate", "--command", "record.csv", "--duration", "2"], &["--duration", "record.csv is flown"]),
        (&["demo", "--rig", "eha"], &["--rig eha", "expected no other"]),
        (&["reproduce", "--rig", "force-axis"], &["`force-axis` is driven by a force"]),
        (&["hil", "record.csv", "--seconds", "2"], &["--seconds"]),
        (&["hil", "--baud", "9600"], &["--port"]),
        (&["hil", "--port", "/dev/null", "--machine", "mps2-an386"], &["--machine"]),
        (&["simulate", "--duration", "0.01"], &["11 samples", "at least 50"]),
        (&["simulate", "--duration", "1e12"], &["--duration", "at most"]),
        (&["simulate", "--duration=-1"], &["--duration -1"]),
        (&["simulate", "--step", "0"], &["--step 0"]),
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
