//! No content of a file makes a reader panic: seeded random damage to valid files, and random bytes.

use host_sim::record::{Mapping, ReadOptions, parse_csv, parse_mat};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Rounds of each test.
const ROUNDS: usize = 2_000;

fn below(random: &mut Xoshiro256PlusPlus, limit: usize) -> usize {
    (random.next_u64() % limit.max(1) as u64) as usize
}

/// Replaces, removes, repeats or inserts some bytes.
fn damage(random: &mut Xoshiro256PlusPlus, bytes: &mut Vec<u8>, alphabet: &[u8]) {
    for _ in 0..=below(random, 4) {
        let place = below(random, bytes.len());
        let byte = if alphabet.is_empty() {
            random.next_u64().to_le_bytes()[0]
        } else {
            alphabet[below(random, alphabet.len())]
        };
        match below(random, 8) {
            0 => bytes.truncate(place),
            1 => {
                let end = (place + below(random, 64)).min(bytes.len());
                let piece = bytes[place.min(end)..end].to_vec();
                bytes.splice(place..place, piece);
            }
            2 => {
                let end = (place + below(random, 64)).min(bytes.len());
                bytes.drain(place.min(end)..end);
            }
            3 => bytes.insert(place, byte),
            _ => {
                if let Some(old) = bytes.get_mut(place) {
                    *old = byte;
                }
            }
        }
    }
}

fn some_options(random: &mut Xoshiro256PlusPlus) -> ReadOptions {
    let columns = if below(random, 2) == 0 {
        Mapping::default()
    } else {
        Mapping::parse(["lvdt_m=data.pos[mm]", "t_s=t_s[us]"]).expect("valid")
    };
    ReadOptions {
        columns,
        sample_rate_hz: (below(random, 2) == 0).then_some(1e3),
        from_s: (below(random, 3) == 0).then_some(5e-3),
        to_s: None,
        inputs_only: below(random, 2) == 0,
    }
}

#[test]
fn text_never_panics() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut plain = b"# comment\nt_s,command_m,lvdt_m,data.pos\n".to_vec();
    for row in 0..60 {
        let cells =
            format!("{:.3},{:.5},{:.5},{row}\r\n", f64::from(row) * 1e-3, 1e-4 * f64::from(row), 2e-4);
        plain.extend_from_slice(cells.as_bytes());
    }
    for _ in 0..ROUNDS {
        let options = some_options(&mut random);
        let mut bytes = plain.clone();
        damage(&mut random, &mut bytes, b"0123456789.,;\t\n\r#\"eE+-naif \xff\xc3");
        drop(parse_csv("noise.csv", &bytes, &options));
        let noise: Vec<u8> =
            (0..below(&mut random, 300)).map(|_| random.next_u64().to_le_bytes()[0]).collect();
        drop(parse_csv("noise.csv", &noise, &options));
    }
}

#[test]
fn mat_never_panics() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(2);
    let level73 = {
        let mut builder = hdf5_pure::mat::MatBuilder::new(hdf5_pure::mat::Options::default());
        let values: Vec<f64> = (0..60).map(f64::from).collect();
        for name in ["t_s", "command_m", "lvdt_m"] {
            builder.write_f64(name, &[60, 1], &values).expect("in memory");
        }
        builder
            .struct_("data", |data| data.write_f64("pos", &[60, 1], &values).map(|_| ()))
            .expect("in memory");
        builder.finish().expect("in memory")
    };
    let compressed = include_bytes!("../../data/scipy.mat").to_vec();
    let plain = include_bytes!("../../data/scipy_plain.mat").to_vec();
    for plain in [level73, compressed, plain] {
        for _ in 0..ROUNDS {
            let options = some_options(&mut random);
            let mut bytes = plain.clone();
            damage(&mut random, &mut bytes, &[]);
            drop(parse_mat("noise.mat", &bytes, &options));
        }
    }
}
