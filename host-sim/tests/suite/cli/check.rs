//! What a record is worth, before any fit.

use super::harness::{Bench, named, number, with_cells};
use serde_json::Value;

/// The entry for a set of channels.
fn foreseen<'a>(record: &'a Value, channels: &[&str]) -> &'a Value {
    let entries = record["foreseen"].as_array().expect("a list");
    &entries
        .iter()
        .find(|entry| entry["channels"] == serde_json::json!(channels))
        .expect("the set of channels")["faults"]
}

#[test]
fn it_foresees_the_standard_errors_that_a_fit_then_has() {
    let bench = Bench::new();
    bench.noisy_record();
    let check =
        bench.run(&["check", "record.csv", "--at", "bkl=2e-4", "--at", "fdj=800", "--json"]).done().json();
    let fit = bench.run(&["identify", "record.csv", "--json"]).done().json();
    let both = foreseen(&check["records"][0], &["lvdt_m", "current_mA"]);
    for name in ["bkl", "fdj"] {
        let promised = number(&named(both, name)["standard_error"]);
        let found = number(&named(&fit["faults"], name)["standard_error"]);
        assert!((promised / found - 1.0).abs() < 0.1, "{name}: {promised} foreseen, {found} found");
    }
    // Without the current, the two look alike: the friction is known far less well.
    let alone = number(&named(foreseen(&check["records"][0], &["lvdt_m"]), "fdj")["standard_error"]);
    assert!(alone > 10.0 * number(&named(both, "fdj")["standard_error"]), "{alone}");
}

#[test]
fn the_command_that_it_recommends_is_better() {
    let bench = Bench::new();
    let sensors = ["--noise", "lvdt_m=5e-6", "--channels", "lvdt_m"];
    bench.simulate("ramp.csv", &[&["--model", "lf", "--command", "ramp"][..], &sensors].concat());
    let before = bench.run(&["check", "ramp.csv", "--json"]).done().json();
    let record = &before["records"][0];
    assert!(record["notes"].to_string().contains("never turns"), "{record}");
    assert!(number(&record["best_command_gain"]) > 1.2, "{record}");
    let best = &record["commands"][0];
    assert!(number(&best["saturated_share"]) <= 0.01, "{best}");
    let command = best["command"].as_str().expect("a name");
    let amplitude = number(&best["amplitude"]).to_string();
    let mut arguments = vec!["--model", "lf", "--command", command];
    if amplitude != "0" {
        arguments.extend(["--amplitude", &amplitude]);
    }
    bench.simulate("best.csv", &[&arguments[..], &sensors].concat());
    let error = |name: &str| {
        let fit = bench.run(&["identify", name, "--json"]).done().json();
        ["bkl", "fdj"].map(|fault| number(&named(&fit["faults"], fault)["standard_error"]))
    };
    let (ramp, best) = (error("ramp.csv"), error("best.csv"));
    assert!(best[0] * best[1] < ramp[0] * ramp[1], "{best:?} {ramp:?}");
}

#[test]
fn it_says_what_is_wrong_with_a_record() {
    let bench = Bench::new();
    let options = ["--model", "lf", "--command", "sine", "--noise", "lvdt_m=5e-6", "--dropout", "0.05"];
    bench.simulate("record.csv", &options);
    // The LVDT cut off at 2 mm.
    let cut = with_cells(&bench.read("record.csv"), "lvdt_m", |_, cell| {
        let beyond = cell.parse::<f64>().is_ok_and(|value| value > 2e-3);
        if beyond { "0.002".to_owned() } else { cell.to_owned() }
    });
    bench.write("cut.csv", &cut);
    let check = |name: &str| bench.run(&["check", name, "--json"]).done().json()["records"][0].clone();
    let (sound, cut) = (check("record.csv"), check("cut.csv"));
    assert!(cut["notes"].to_string().contains("is it clipped?"), "{cut}");
    assert!(!sound["notes"].to_string().contains("clipped"), "{sound}");
    let lvdt = named(&sound["channels"], "lvdt_m");
    assert!((number(&lvdt["noise"]) / 5e-6 - 1.0).abs() < 0.15, "{lvdt}");
    assert!((20.0..90.0).contains(&number(&lvdt["missing"])), "{lvdt}");
    // The servo loop's gain of 0.1 per 10 ms: the position is some 10 ms late.
    let delay = number(&sound["response"]["delay_s"]);
    assert!((2e-3..5e-2).contains(&delay), "{delay}");
    assert_eq!(
        sound["motion"]["reversals"], 9,
        "4 mm at 5 Hz for a second turns ten times, the last beyond its end"
    );
    let text = bench.run(&["check", "record.csv", "cut.csv"]).done().stdout;
    for part in ["lvdt_m + current_mA", "best first", "response behind the command", "seed 1"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn it_counts_what_no_actuator_makes() {
    let bench = Bench::new();
    bench.simulate("record.csv", &["--model", "lf", "--command", "sine", "--noise", "lvdt_m=5e-6"]);
    let spiky = with_cells(&bench.read("record.csv"), "lvdt_m", |sample, cell| match sample {
        400 => "0".to_owned(),
        601..606 => "0.0012345".to_owned(),
        _ => cell.to_owned(),
    });
    bench.write("spiky.csv", &spiky);
    let check = |name: &str| bench.run(&["check", name, "--json"]).done().json()["records"][0].clone();
    let counts = |record: &Value| {
        ["spikes", "stuck"].map(|kind| named(&record["channels"], "lvdt_m")[kind].as_u64().expect("a count"))
    };
    let (sound, spiky) = (check("record.csv"), check("spiky.csv"));
    assert_eq!((counts(&sound), counts(&spiky)), ([0, 0], [2, 4]));
    let note = "spiky.csv: lvdt_m: 2 spikes from 0.4 to 0.601 s, 4 stuck samples from 0.602 to 0.605 s";
    assert!(bench.run(&["check", "spiky.csv"]).done().stdout.contains(&note["spiky.csv: ".len()..]));
    assert!(!sound["notes"].to_string().contains("spike"), "{sound}");
    // A fit says the same.
    let fit = bench.run(&["identify", "spiky.csv", "--json"]).done();
    assert!(fit.json()["warnings"].to_string().contains(note), "{}", fit.stdout);
    assert!(fit.stderr.contains(note), "{}", fit.stderr);
}

#[test]
fn it_says_what_is_wrong_with_a_set_up() {
    let bench = Bench::new();
    bench.noisy_record();
    let sound = bench.read("record.csv");
    let times = |cell: &str, factor: f64| {
        cell.parse::<f64>().map_or_else(|_| cell.to_owned(), |value| (value * factor).to_string())
    };
    let names = [
        "amperes.csv",
        "millimetres.csv",
        "turned.csv",
        "far.csv",
        "swapped.csv",
        "late.csv",
        "another_zero.csv",
    ];
    bench.write(names[0], &with_cells(&sound, "current_mA", |_, cell| times(cell, 1e-3)));
    bench.write(names[1], &with_cells(&sound, "lvdt_m", |_, cell| times(cell, 25.4)));
    bench.write(names[2], &with_cells(&sound, "lvdt_m", |_, cell| times(cell, -1.0)));
    let far = |_: usize, cell: &str| cell.parse::<f64>().map_or(0.3, |value| value + 0.3).to_string();
    bench.write(names[3], &with_cells(&with_cells(&sound, "lvdt_m", far), "command_m", far));
    bench.write(
        names[4],
        &sound.replace("command_m", "spare").replace("lvdt_m", "command_m").replace("spare", "lvdt_m"),
    );
    // 50 ms later, and 5 mm beside.
    let positions: Vec<&str> = sound
        .lines()
        .filter_map(|line| line.split(',').nth(2))
        .skip_while(|cell| *cell != "lvdt_m")
        .collect();
    let later = |row: usize, _: &str| positions[1 + row.abs_diff(50)].to_owned();
    bench.write(names[5], &with_cells(&sound, "lvdt_m", later));
    let beside = |_: usize, cell: &str| (cell.parse::<f64>().expect("a number") + 5e-3).to_string();
    bench.write(names[6], &with_cells(&sound, "lvdt_m", beside));
    let said = [
        "`--columns 'current_mA=current_mA[A]'`",
        "`--columns 'lvdt_m=lvdt_m*3.937007874015748e-2'`",
        "`--columns 'lvdt_m=lvdt_m[m]*-1'`",
        "the jack's stop is at 0.2 m",
        "ahead of command_m: are their columns swapped? `--columns 'lvdt_m=command_m[m],command_m=lvdt_m[m]'`",
        "whatever its faults: is something delayed",
        "beside what the rig answers, whatever its faults",
    ];
    let check =
        |name: &str| bench.run(&["check", name, "--json"]).done().json()["records"][0]["notes"].to_string();
    assert_eq!(check("record.csv"), "[]");
    for (name, said) in names.into_iter().zip(said) {
        let notes = check(name);
        assert!(notes.contains(said), "{name}: {notes}");
    }
    assert!(bench.run(&["check", names[0]]).done().stdout.contains(said[0]));
    // A fit says the same.
    let fit = bench.run(&["identify", names[0], "--json"]).done();
    assert!(fit.json()["warnings"].to_string().contains(said[0]), "{}", fit.stdout);
}

#[test]
fn a_noise_of_the_rig_in_another_unit_is_told() {
    let bench = Bench::new();
    bench.noisy_record();
    let notes = |noise: &str| {
        bench.write("rig.toml", &format!("[noise]\n{noise}\n"));
        let checked = bench.run(&["check", "record.csv", "--rig", "rig.toml", "--json"]).done().json();
        checked["records"][0]["notes"].to_string()
    };
    // The controls are what somebody may believe of a sensor.
    for sound in ["lvdt_m = 5e-6", "lvdt_m = 5e-7", "lvdt_m = 1e-4\ncurrent_mA = 0.2", "ram_m = 5"] {
        assert!(!notes(sound).contains("[noise]"), "{sound}");
    }
    let nanometres = notes("lvdt_m = 5e-9");
    assert!(nanometres.contains("a noise of 5e-9 m for lvdt_m ([noise]), the record shows "), "{nanometres}");
    assert!(notes("current_mA = 2e-5").contains("a noise of 0.00002 mA for current_mA"));
    assert!(notes("lvdt_m = 5").contains("a noise of 5 m for lvdt_m"));
    // Fits say the same.
    for verb in ["identify", "calibrate", "diagnose"] {
        let bounds = if verb == "calibrate" { &["--bounds", "fdj=200..4000"][..] } else { &[] };
        let run = bench.run(&[&[verb, "record.csv", "--rig", "rig.toml"][..], bounds].concat()).done();
        let said = "warning: record.csv: the rig states a noise of 5 m for lvdt_m";
        assert_eq!(run.stderr.matches(said).count(), 1, "{verb}: {}", run.stderr);
    }
}

/// The options in back quotes that notes offer.
fn offered(notes: &str) -> Vec<&str> {
    notes.split('`').filter_map(|part| part.strip_prefix("--columns '")?.strip_suffix('\'')).collect()
}

#[test]
fn it_tells_a_ram_in_the_column_of_the_user() {
    let bench = Bench::new();
    let check = |name: &str, columns: &str| {
        let checked = bench.run(&["check", name, "--columns", columns, "--json"]).done().json();
        checked["records"][0]["notes"].to_string()
    };
    let right = "lvdt_m=user pos[mm],ram_m=Ram [mm]";
    let swapped = "lvdt_m=Ram [mm],ram_m=user pos[mm]";
    for (command, play, is_told) in
        [("chirp", "bkl=2e-4", true), ("mixed", "bkl=5e-5", true), ("chirp", "bkl=0", false)]
    {
        let noise = ["--noise", "lvdt_m=5e-6,ram_m=5e-6", "--channels", "lvdt_m,ram_m"];
        bench.simulate(
            "si.csv",
            &[&["--model", "lf", "--command", command, "--set", play][..], &noise].concat(),
        );
        let in_mm = |_: usize, cell: &str| cell.parse::<f64>().map_or(0.0, |value| value * 1e3).to_string();
        let text = with_cells(&with_cells(&bench.read("si.csv"), "lvdt_m", in_mm), "ram_m", in_mm);
        bench.write("bench.csv", &text.replacen("lvdt_m", "user pos", 1).replacen("ram_m", "Ram [mm]", 1));
        let notes = check("bench.csv", swapped);
        assert_eq!(offered(&notes), if is_told { vec![right] } else { vec![] }, "{command} {play}: {notes}");
        assert_eq!(check("bench.csv", right), "[]", "{command} {play}");
    }
}

#[test]
fn columns_that_look_swapped_are_exchanged_with_each_other() {
    let bench = Bench::new();
    bench.noisy_record();
    let notes = |columns: &[&str]| {
        let checked = bench.run(&[&["check", "record.csv", "--json"], columns].concat()).done().json();
        checked["records"][0]["notes"].to_string()
    };
    let swapped = notes(&["--columns", "lvdt_m=current_mA*1e-3,current_mA=lvdt_m*1e3"]);
    let said = "lvdt_m and current_mA look swapped: `--columns 'lvdt_m=lvdt_m[mm],current_mA=current_mA[A]'`";
    assert!(swapped.contains(said), "{swapped}");
    assert!(!notes(&[]).contains("look swapped"));
}

#[test]
fn what_is_clipped_tells_nothing_of_the_noise() {
    let bench = Bench::new();
    bench.noisy_record();
    let cut = with_cells(&bench.read("record.csv"), "lvdt_m", |_, cell| {
        cell.parse::<f64>().map_or_else(|_| cell.to_owned(), |value| value.min(4e-3).to_string())
    });
    bench.write("cut.csv", &cut);
    let check = |name: &str| bench.run(&["check", name, "--json"]).done().json()["records"][0].clone();
    let noise = |record: &Value| number(&named(&record["channels"], "lvdt_m")["noise"]);
    let (sound, cut) = (check("record.csv"), check("cut.csv"));
    assert!(number(&named(&cut["channels"], "lvdt_m")["saturated_share"]) > 0.4, "{cut}");
    assert!((noise(&cut) / noise(&sound) - 1.0).abs() < 0.1, "{cut}");
    let error = |record: &Value| number(&named(foreseen(record, &["lvdt_m"]), "bkl")["standard_error"]);
    assert!(error(&cut) > 0.95 * error(&sound), "{} {}", error(&cut), error(&sound));
    let fit = bench.run(&["identify", "cut.csv", "--json"]).done();
    assert!(fit.json()["warnings"].to_string().contains("is it clipped?"), "{}", fit.stdout);
    // What rests because its command does is not clipped.
    bench.simulate("step.csv", &["--model", "lf", "--command", "step", "--duration", "0.5"]);
    let step = check("step.csv");
    assert!(number(&named(&step["channels"], "ram_m")["saturated_share"]) > 0.01, "{step}");
    assert!(!step["notes"].to_string().contains("clipped"), "{step}");
    // Nor is what dwells in a play wherever it turns.
    bench.simulate("play.csv", &["--model", "lf", "--command", "chirp", "--set", "bkl=5e-4"]);
    let play = check("play.csv");
    assert!(number(&named(&play["channels"], "lvdt_m")["saturated_share"]) > 0.01, "{play}");
    assert!(!play["notes"].to_string().contains("clipped"), "{play}");
}

#[test]
fn a_record_that_stands_still_says_nothing() {
    let bench = Bench::new();
    bench.noisy_record();
    let still = with_cells(&bench.read("record.csv"), "command_m", |_, _| "0".to_owned());
    let noise = |sample: usize| ((sample as f64 * 12.9898).sin() * 43_758.545_3).fract();
    let still = with_cells(&still, "lvdt_m", |sample, _| (5e-6 * noise(sample)).to_string());
    bench.write("still.csv", &still);
    let text = bench.run(&["check", "still.csv"]).done().stdout;
    assert!(text.contains("this record says nothing: command and actuator do not move"), "{text}");
    assert!(text.contains("would tell something") && !text.contains("inf"), "{text}");
    assert!(!text.contains("foreseen standard errors"), "{text}");
}
