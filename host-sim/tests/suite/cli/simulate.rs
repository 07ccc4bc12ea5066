//! Records that the program makes, and those that it converts.

use super::harness::{BKL, Bench, FDJ, USAGE, named, number};

#[test]
fn the_seed_alone_decides_the_noise() {
    let bench = Bench::new();
    let sensors =
        ["--model", "lf", "--noise", "lvdt_m=5e-6", "--quantum", "lvdt_m=1e-6", "--dropout", "0.02"];
    for (name, seed) in [("a.csv", "4"), ("b.csv", "4"), ("c.csv", "5")] {
        bench.simulate(name, &[&sensors[..], &["--seed", seed]].concat());
    }
    let text = bench.read("a.csv");
    assert_eq!(text, bench.read("b.csv"));
    assert_ne!(text.replace("seed 4", "seed 5"), bench.read("c.csv"));
    assert!(text.contains("seed 4") && text.contains("bkl = 0.0002 m"), "the record says how it was made");
    for line in text.lines().skip_while(|line| !line.starts_with("t_s")).skip(1) {
        let Ok(position) = line.split(',').nth(2).expect("a position").parse::<f64>() else { continue };
        let steps = position / 1e-6;
        assert!((steps - steps.round()).abs() < 1e-6, "{position} is not a whole number of micrometres");
    }
}

#[test]
fn a_record_says_with_which_step_it_was_made() {
    let bench = Bench::new();
    for (asked, used) in [("1e-4", 1e-4), ("3e-5", 1e-3 / 34.0), ("7e-5", 1e-3 / 15.0)] {
        let short = ["simulate", "--model", "lf", "--duration", "0.1", "--step", asked];
        bench.run(&[&short[..], &["-o", "record.csv"]].concat()).done();
        let text = bench.read("record.csv");
        let (_, rest) = text.split_once(", step ").expect("a step");
        let step: f64 = rest.split_once(" s,").expect("its unit").0.parse().expect("a number");
        assert!((step / used - 1.0).abs() < 1e-9, "{asked}: {step}");
        let result = bench.run(&[&short[..], &["--json"]].concat()).done().json();
        assert_eq!(number(&result["config"]["step_s"]), step);
        // The model as it is typed.
        assert!(text.contains(", model lf, step ") && result["config"]["model"] == "lf", "{text}");
    }
}

#[test]
fn every_command_runs() {
    let bench = Bench::new();
    let list = bench.run(&["commands", "--json"]).done().json();
    for command in list["commands"].as_array().expect("a list") {
        let name = command["name"].as_str().expect("a name");
        bench.simulate("record.csv", &["--model", "lf", "--command", name, "--duration", "0.5"]);
        let run = bench.run(&["identify", "record.csv", "--json"]).done();
        assert!(number(&run.json()["residual_rms_m"]) < 1e-6, "{name}: {}", run.stdout);
    }
}

#[test]
fn every_effect_runs_and_changes_the_record() {
    let bench = Bench::new();
    let short = ["--model", "lf", "--command", "sine", "--duration", "0.3", "--amplitude", "0.02"];
    bench.simulate("plain.csv", &short);
    let values = |name: &str| {
        let text = bench.read(name);
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    let plain = values("plain.csv");
    let list = bench.run(&["effects", "--json"]).done().json();
    let effects = list["effects"].as_array().expect("a list");
    assert!(effects.len() >= 27, "{} effects", effects.len());
    // A valve drives this actuator.
    for effect in effects.iter().filter(|effect| effect["port"] != "drive") {
        let name = effect["name"].as_str().expect("a name");
        // A hundredth of the range, so that the actuator still moves (leakage could hold it).
        let sizes: Vec<String> = effect["parameters"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|parameter| {
                let [absent, lower, upper] =
                    ["default", "lower", "upper"].map(|member| number(&parameter[member]));
                let end = if upper > absent { upper } else { lower };
                let time = parameter["unit"] == "s" && parameter["name"] != "sensor_lag";
                (if time { 0.003 } else { absent + 0.01 * (end - absent) }).to_string()
            })
            .collect();
        let setting = format!("{name}={}", sizes.join(","));
        bench.simulate("effect.csv", &[&short[..], &["--effect", &setting]].concat());
        assert_ne!(values("effect.csv"), plain, "{setting}");
    }
}

#[test]
fn a_record_can_be_flown_again() {
    let bench = Bench::new();
    bench.simulate("first.csv", &["--load", "sine:500:3", "--channels", "lvdt_m"]);
    bench.simulate("again.csv", &["--command", "first.csv", "--channels", "lvdt_m"]);
    let rows = |name: &str| {
        let text = bench.read(name);
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(rows("first.csv"), rows("again.csv"));
    assert!(rows("first.csv")[0].contains("load_N"));
}

#[test]
fn a_known_controller_drives_its_axis() {
    let bench = Bench::new();
    let rig = "base = \"force-axis\"\nfault = []\n[controller]\nposition-gain = 160.0\nvelocity-gain = 243.0\n\
               limit = 10.0\nforce-gain = 35.0\n";
    bench.write("axis.toml", rig);
    // To and fro, smoothly from rest: a jerk at the start would still ring where the fit begins to compare.
    let row = |k: u32| {
        let t = f64::from(k) * 1e-3;
        let x = 0.04 * (1.0 - (std::f64::consts::PI * t).cos());
        format!("{t:.3},{x},{x}")
    };
    let flight: Vec<String> = (0..4001).map(row).collect();
    bench.write("flight.csv", &format!("t_s,command_m,lvdt_m\n{}\n", flight.join("\n")));
    let actuator = ["--set", "load_mass=120", "--set", "viscous_friction=250", "--set", "fdj=30"];
    let sensors = ["--noise", "lvdt_m=1e-6", "--step", "1e-4", "-o", "axis.csv"];
    bench
        .run(
            &[&["simulate", "--rig", "axis.toml", "--command", "flight.csv"][..], &actuator, &sensors]
                .concat(),
        )
        .done();
    let result = bench.run(&["calibrate", "axis.csv", "--rig", "axis.toml", "--json"]).done().json();
    for (name, truth) in [("load_mass", 120.0), ("viscous_friction", 250.0), ("fdj", 30.0)] {
        let found = number(&named(&result["parameters"], name)["value"]);
        assert!((found / truth - 1.0).abs() < 2e-3, "{name}: {found}");
    }
    assert!(number(&result["closed_loop"]["force_error"]) < 1e-3, "{result}");
    // A rig that is driven by a force and knows no controller has nothing to be driven by.
    bench.run(&["simulate", "--rig", "force-axis"]).refused(USAGE, &["drive_N", "[controller]"]);
}

#[test]
fn the_rig_that_is_printed_is_accepted() {
    let bench = Bench::new();
    bench.noisy_record();
    for rig in ["eha", "servo-hydraulic", "force-axis"] {
        let text = bench.run(&["rigs", rig]).done().stdout;
        assert!(
            text.contains("flapper_damping = 0.6 # ZF, 0.05 to 5, damping ratio of the flapper\n"),
            "{text}"
        );
        bench.write("rig.toml", &text);
        let again = bench.run(&["rigs", "rig.toml"]).done().stdout;
        // The first line says where the rig comes from.
        assert_eq!(again.split_once('\n').map(|(_, rest)| rest), text.split_once('\n').map(|(_, rest)| rest));
    }
    bench.write("eha.toml", &bench.run(&["rigs", "eha"]).done().stdout);
    let faults = |rig: &str| {
        bench.run(&["identify", "record.csv", "--json", "--rig", rig]).done().json()["faults"].clone()
    };
    assert_eq!(faults("eha.toml"), faults("eha"));
}

#[test]
fn a_mat_file_becomes_a_record_that_identify_accepts() {
    let bench = Bench::new();
    for fixture in ["scipy.mat", "scipy_plain.mat"] {
        let mat = format!("{}/tests/data/{fixture}", env!("CARGO_MANIFEST_DIR"));
        bench.run(&["import", &mat, "-o", "fixture.csv"]).done();
        bench.run(&["identify", "fixture.csv", "--json"]).done().json();
    }
    bench.noisy_record();
    write_mat(&bench, "record.csv", "record.mat");
    bench.run(&["import", "record.mat", "-o", "imported.csv"]).done();
    let result = bench.run(&["identify", "imported.csv", "--json"]).done().json();
    let direct = bench.run(&["identify", "record.csv", "--json"]).done().json();
    assert_eq!(result["faults"], direct["faults"]);
    assert!((number(&named(&result["faults"], "fdj")["value"]) / FDJ - 1.0).abs() < 0.02);
    assert!((number(&named(&result["faults"], "bkl")["value"]) / BKL - 1.0).abs() < 0.02);
}

/// Writes the columns of a record as variables of a MAT v7.3 file, with a writer that is not the program's.
fn write_mat(bench: &Bench, record: &str, mat: &str) {
    use hdf5_pure::mat::{MatBuilder, Options};
    let text = bench.read(record);
    let mut rows = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = rows.next().expect("a header").split(',').collect();
    let mut columns = vec![Vec::new(); names.len()];
    for row in rows {
        for (column, cell) in columns.iter_mut().zip(row.split(',')) {
            column.push(cell.parse::<f64>().expect("a number"));
        }
    }
    let mut builder = MatBuilder::new(Options::default());
    for (name, values) in names.into_iter().zip(columns) {
        builder.write_f64(name, &[values.len(), 1], &values).expect("a variable");
    }
    std::fs::write(bench.path(mat), builder.finish().expect("a file")).expect("a file");
}
