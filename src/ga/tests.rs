use super::*;

fn bowl(genes: &[f64; 2]) -> f64 {
    (genes[0] - 0.3).powi(2) + 4.0 * (genes[1] - 0.7).powi(2)
}

fn run<const SIZE: usize>(seed: u64, evaluations: usize) -> SteadyState<f64, 2, SIZE> {
    let mut search = SteadyState::<f64, 2, SIZE>::new(Settings::default(), 2, seed);
    for _ in 0..evaluations {
        let genes = search.ask();
        assert!(genes.iter().all(|gene| (0.0..=1.0).contains(gene)));
        search.tell(bowl(&genes));
    }
    search
}

#[test]
fn first_population_covers_every_stratum_of_every_gene() {
    let mut search = SteadyState::<f64, 3, 20>::new(Settings::default(), 3, 1);
    let mut seen = [[false; 20]; 3];
    for _ in 0..20 {
        let genes = search.ask();
        for (gene, seen) in genes.iter().zip(&mut seen) {
            seen[(gene * 20.0) as usize] = true;
        }
        search.tell(1.0);
    }
    assert!(seen.iter().flatten().all(|&hit| hit));
}

#[test]
fn finds_the_bottom_of_a_bowl_for_every_seed() {
    for seed in 0..50 {
        let search = run::<20>(seed, 400);
        let (genes, _) = search.best().unwrap();
        assert!((genes[0] - 0.3).abs() < 0.02 && (genes[1] - 0.7).abs() < 0.02, "seed {seed}: {genes:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_search_whatever_the_capacity() {
    let (small, large) = (run::<20>(7, 300), run::<64>(7, 300));
    assert_eq!(small.best(), large.best());
    assert_eq!(small.counters(), large.counters());
    assert_ne!(small.best(), run::<20>(8, 300).best());
}

#[test]
fn counters_of_a_known_search() {
    // A snapshot: behaviour, not only the answer. It changes only with the search itself.
    let counters = run::<20>(1, 400).counters();
    assert_eq!(counters.evaluations, 400);
    assert!(counters.replacements > 100 && counters.improvements > 10, "{counters:?}");
}

#[test]
fn a_cost_that_is_not_a_number_is_refused() {
    let mut search = run::<20>(3, 100);
    let before = search.best().map(|(genes, cost)| (*genes, cost));
    search.ask();
    assert_eq!(search.tell(f64::NAN), Outcome::Rejected);
    search.ask();
    assert_eq!(search.tell(f64::INFINITY), Outcome::Rejected);
    assert_eq!(search.best().map(|(genes, cost)| (*genes, cost)), before);
}
