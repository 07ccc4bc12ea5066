//! Random bytes, by the entry points of the fuzz targets, for a bounded number of runs.

#[path = "../../fuzz/entry.rs"]
mod entry;

use eha_monitor::random::Random;

fn bytes(random: &mut Random, count: usize) -> Vec<u8> {
    (0..count).map(|_| random.below(256) as u8).collect()
}

/// Feeds samples to the monitor for every rig and to the plain one.
fn to_both(stream: &mut [u8]) {
    for which in [0, 1] {
        stream[0] = which;
        entry::stream(stream);
    }
}

#[test]
fn no_sample_can_harm_the_monitor() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let mut stream = bytes(&mut random, 1 + 13 * 1200);
        // From wild to mostly tame: of 128 samples.
        let tame = [0, 64, 122, 127][seed as usize % 4];
        for chunk in stream[1..].chunks_exact_mut(13) {
            if random.below(128) < tame {
                chunk[0] = 0x01;
            }
        }
        to_both(&mut stream);
    }
}

#[test]
fn the_worst_values_in_every_place() {
    let wild =
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE, -0.0, 1e-42, 0.3, -0.25];
    for value in wild {
        for place in 0..3 {
            let mut stream = vec![0];
            for number in 0..300_u32 {
                let mut words = [1_u32 << 28, 1 << 28, 1 << 28].map(|word| word.wrapping_mul(number % 7));
                words[place] = value.to_bits();
                stream.push([0x31, 0xc1, 0xa1][place]);
                stream.extend(words.iter().flat_map(|word| word.to_le_bytes()));
            }
            to_both(&mut stream);
        }
    }
}

#[test]
fn no_bytes_are_taken_for_a_snapshot() {
    let mut random = Random::new(9);
    for length in 0..500 {
        entry::restore(&bytes(&mut random, length));
    }
}

#[test]
fn no_word_of_a_snapshot_can_harm_the_monitor() {
    let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e9, 1e9, -1.0, 1.0, 0.5, 1e-42];
    let wild: Vec<u32> =
        wild.into_iter().map(f32::to_bits).chain([0, 1, 2, 3, u32::MAX, 1 << 31, 299, 300]).collect();
    let words = entry::words();
    let mut random = Random::new(4);
    for place in 0..words {
        // Of the samples of a window any word is one: a few of them will do.
        let is_sample = place < words - 260 && !place.is_multiple_of(97);
        if !is_sample {
            for word in &wild {
                let mut bytes = (place as u16).to_le_bytes().to_vec();
                bytes.extend(word.to_le_bytes());
                entry::restore(&bytes);
            }
        }
    }
    for _ in 0..20 {
        entry::restore(&bytes(&mut random, 6 * 3));
    }
}
