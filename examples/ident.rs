#![allow(missing_docs)]
use eha_monitor::channel::*;
use eha_monitor::command::*; use eha_monitor::integrate::exact::*; use eha_monitor::integrate::midpoint::*; use eha_monitor::integrate::*;
use eha_monitor::model::state::*; use eha_monitor::model::*; use eha_monitor::parameter::*; use eha_monitor::simulate::*;
use eha_monitor::fit::{problem::*,identify::*};
fn sim<S: Stepper<f64>>(p:&Parameters<f64>, s:&mut S, com:&[f64], dt:f64)->Vec<Outputs<f64>>{
  let a=Actuator::new(Model::new(Form::default(),p),dt); s.begin(dt,false,true);
  let mut m=a.at_rest(com[0],&Input{command:com[0],..Default::default()});
  let mut out=vec![a.measure(&mut m,&Input{command:com[0],..Default::default()})];
  for k in 1..com.len(){ let seg=InputSegment::between([com[k-1],com[k]],[0.;2],dt*(k as f64-1.),1./dt); a.advance(s,&mut m,&seg); out.push(a.measure(&mut m,&seg.at(dt))); }
  out
}
fn gauss(s:&mut u64)->f64{ let mut a=0.; for _ in 0..12 { *s^=*s<<13; *s^=*s>>7; *s^=*s<<17; a+=(*s>>11) as f64/(1u64<<53) as f64; } a-6. }
fn main(){
  let cases=[("mixed",1e-3,6400.),("mixed",2e-4,800.),("chirp",0.,400.),("chirp",0.,800.),("chirp",0.,1600.),("chirp",0.,3200.),("chirp",0.,400.),("chirp",1e-4,200.),("chirp",2e-4,200.),("chirp",5e-4,200.),("chirp",1e-3,200.),("chirp",1e-4,800.)];
  for (noisy,hf) in [(false,false),(true,false),(false,true)] { for (i,(name,bkl,fdj)) in cases.iter().enumerate() {
    let c=Command::<f64>::new(CommandInfo::named(name).unwrap()); let com:Vec<f64>=(0..=1000).map(|k|c.at(k as f64*1e-3)).collect();
    let mut p=Parameters::<f64>::default(); p.fdj=*fdj; p.bkl=*bkl; if hf {p.metering_blend=1.0;}
    let out= sim(&p,&mut Midpoint::new(1e-6),&com,1e-3);
    let (mut worst,mut wb,mut wf,mut ev,mut evmax,mut us)=(0f64,0f64,0f64,0,0,0.); let mut se=[0.;2]; let mut reasons=String::new(); let mut lastx=0.;
    let n= if hf {3} else {20};
    for seed in 0..n {
      let mut rs=seed*7919+12345; for _ in 0..10 {gauss(&mut rs);}
      let (nu,nc)= if noisy {(5e-6,0.02)} else {(0.,0.)};
      let lv:Vec<f64>=out.iter().map(|o|o.user+nu*gauss(&mut rs)).collect(); let cu:Vec<f64>=out.iter().map(|o|o.current+nc*gauss(&mut rs)).collect();
      let free=[Free{parameter:Parameter::Backlash,lower:0.,upper:1.5e-3},Free{parameter:Parameter::DryFriction,lower:if i==0 {200.} else {200.},upper:if i==0 {8000.} else {4000.}}];
      let st=Start::default(); let rec=[Record::new(1e-3,&com,&st).with(Channel::UserPosition,&lv).with(Channel::Current,&cu)];
      let mut base=Parameters::default(); base.metering_blend=0.;
      let pr=Problem{form:Form::default(),parameters:base,free:&free,records:&rec,noise:[5e-6,5e-6,0.02,1e4]};
      let mut id=Identification::<f64,2,64>::new(&pr,Settings::default(),seed);
      let t=std::time::Instant::now(); let mut s=[Exact::<f64,5,32>::new(),Exact::new(),Exact::new()];
      let r=id.run(&pr,&mut s); us+=t.elapsed().as_secs_f64()*1e6/n as f64;
      let f=id.result().unwrap(); let v=[free[0].value(f.genes[0]),free[1].value(f.genes[1])];
      let eb= if *bkl>0. {(v[0]-bkl).abs()/bkl*100.} else {0.}; let ef=(v[1]-fdj).abs()/fdj*100.;
      worst=worst.max((eb+ef)/2.); wb=wb.max(eb); wf=wf.max(ef); ev+=id.evaluations(); evmax=evmax.max(id.evaluations()); reasons=format!("{r:?}"); lastx=f.normal.misfit.mean_square();
      let cov=f.normal.covariance().unwrap(); se=[cov[(0,0)].sqrt()*free[0].range(),cov[(1,1)].sqrt()*free[1].range()];
      if hf { println!("   {v:?}"); }
    }
    println!("{} noisy {noisy} hf {hf} worst mean err {worst:.4}% bkl {wb:.3}% fdj {wf:.3}% ev {} max {evmax} {us:.0}us se {:.2e} ({:.2}%) {:.2} ({:.2}%) {reasons} chi2/n {lastx:.3e}", i+1, ev/n as u32, se[0], se[0]/bkl*100., se[1], se[1]/fdj*100.);
  } }
}
