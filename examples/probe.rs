#![allow(missing_docs)]
use eha_monitor::command::*;
use eha_monitor::integrate::exact::*;
use eha_monitor::integrate::midpoint::*;
use eha_monitor::integrate::*;
use eha_monitor::model::state::*;
use eha_monitor::model::*;
use eha_monitor::parameter::*;
use eha_monitor::scalar::*;
use eha_monitor::simulate::*;
fn run<T: Real, S: Stepper<T>>(
    p: &Parameters<T>,
    s: &mut S,
    com: &[T],
    dt: T,
) -> (Vec<Outputs<T>>, u32, u32) {
    let a = Actuator::new(Model::new(Form::default(), p), dt);
    let mut m = a.at_rest(com[0], &Input { command: com[0], ..Default::default() });
    let mut out = vec![];
    for k in 1..com.len() {
        let seg = InputSegment::between(
            [com[k - 1], com[k]],
            [T::ZERO; 2],
            dt * T::from_count(k as u32 - 1),
            T::ONE / dt,
        );
        a.advance(s, &mut m, &seg);
        out.push(a.measure(&mut m, &seg.at(dt)));
    }
    (out, m.run.events, m.run.steps)
}
fn main() {
    for info in &COMMANDS {
        for (fdj, bkl) in [(200.0, 0.0), (400., 1e-4), (6400., 1e-3), (0., 0.)] {
            let c = Command::<f64>::new(info);
            let com: Vec<f64> = (0..=1000).map(|k| c.at(k as f64 * 1e-3)).collect();
            let mut p = Parameters::<f64>::default();
            p.fdj = fdj;
            p.bkl = bkl;
            let (r, re, _) = run(&p, &mut Midpoint::new(1e-3, 1e-6), &com, 1e-3);
            let mut e = Exact::<f64, 5, 32>::new(1e-3, false);
            let (x, xe, xs) = run(&p, &mut e, &com, 1e-3);
            let t = std::time::Instant::now();
            for _ in 0..200 {
                std::hint::black_box(run(&p, &mut e, &com, 1e-3));
            }
            let us = t.elapsed().as_secs_f64() / 200. * 1e6;
            let (mm, _, _) = run(&p, &mut Midpoint::new(1e-3, 15.625e-6), &com, 1e-3);
            let (m1, _, _) = run(&p, &mut Midpoint::new(1e-3, 1e-5), &com, 1e-3);
            let pf = p.to_f32();
            let comf: Vec<f32> = com.iter().map(|&c| c as f32).collect();
            let (f, _, _) = run(&pf, &mut Exact::<f32, 5, 32>::new(1e-3, false), &comf, 1e-3);
            let rms = |a: &dyn Fn(usize) -> f64| {
                ((0..1000).map(|k| a(k).powi(2)).sum::<f64>() / 1000.).sqrt() * 1e6
            };
            println!(
                "{:10} fdj {:5} ref ev {:4} exact ev {:4} steps {:5} {:6.1}us  exact {:.2e} mid16 {:.2e} mid10 {:.2e} f32 {:.2e} um, cur {:.1e}",
                info.name,
                fdj,
                re,
                xe,
                xs,
                us,
                rms(&|k| x[k].user - r[k].user),
                rms(&|k| mm[k].user - r[k].user),
                rms(&|k| m1[k].user - r[k].user),
                rms(&|k| f[k].user as f64 - x[k].user),
                rms(&|k| (x[k].current - r[k].current) * 1e-6)
            );
        }
    }
}
