use super::sheet::*; use super::map::*; use super::budget::Budget; use super::grid::Numbers; use plywave::{OutgoingGrid,direction}; use plywave::asg::Lobe;
#[test]
fn dev(){
  let grid=OutgoingGrid{theta_o:45,phi_o:90};
  let lobes=|h:f64,t:f64|vec![Lobe{theta_z:-t,phi_z:1.5+2.9,phi_xy:0.3,ln_mu1:1.0,ln_mu2:4.0,energy:0.4},Lobe{theta_z:-t*0.9,phi_z:1.5+h,phi_xy:-0.2,ln_mu1:0.1,ln_mu2:2.0,energy:0.3},Lobe{theta_z:-t*0.5,phi_z:0.1,phi_xy:0.2,ln_mu1:0.5,ln_mu2:1.0,energy:0.1}];
  let ev=|l:&Vec<Lobe>,t:f64,p:f64|{let v=direction(t as f32,p as f32).map(|x|x as f64);l.iter().map(|x|x.eval(v)).sum::<f64>()};
  let mut seed=1u32; let mut rnd=move||{seed=seed.wrapping_mul(1664525).wrapping_add(1013904223);(seed>>8) as f64/16777216.0};
  let mut mk=|title:&str,w,trip:bool|{
    let mut cells=vec![];let mut rows=vec![];
    for t in [0.0f64,30.0,60.0]{ for h in if trip {vec![0.0,0.5,0.9]}else{vec![9.0]}{
      let tt=t.to_radians();
      let mut row=vec![];
      if trip{
        let l=lobes(h,tt);
        let fit=Field::from_fn(grid,|a,b|ev(&l,a,b));
        let tab=Field::from_fn(grid,|a,b|ev(&l,a,b)*(1.0+0.3*(rnd()-0.5)+0.2*(3.0*b).sin()));
        let res=fit.minus(&tab);
        row.push(Cell{field:tab,residual:false,lobes:vec![],theta_i:tt});
        row.push(Cell{field:fit,residual:false,lobes:l,theta_i:tt});
        row.push(Cell{field:res,residual:true,lobes:vec![],theta_i:tt});
        rows.push([format!("θ_i = {t}°"),format!("h = {h} R")]);
      } else { for h in [0.0,0.5,0.9]{let l=lobes(h,tt);row.push(Cell{field:Field::from_fn(OutgoingGrid{theta_o:180,phi_o:360},|a,b|ev(&l,a,b)),residual:false,lobes:l,theta_i:tt});}
        rows.push([format!("θ_i = {t}°"),String::new()]);}
      cells.push(row);
    }}
    Block{title:title.into(),quantity:"f [1/sr]".into(),columns:if trip{vec!["table".into(),"fit".into(),"fit - table".into()]}else{vec!["h = 0".into(),"h = 0.5 R".into(),"h = 0.9 R".into()]},rows,cells,map_width:w,decades:4.0}
  };
  let hs:Vec<f64>=(0..21).map(|i|-1.33+2.66*i as f64/20.0).collect();
  let bud=|t:f64|{let rd:Vec<f64>=hs.iter().map(|h|0.15+0.85*(h.abs().powi(4)/3.2).min(1.0)).collect();Budget{theta_i:t,refl:rd.iter().map(|r|0.08*(1.0-r)).collect(),high:rd.iter().map(|r|0.6*(1.0-r)).collect(),absorbed:rd.iter().map(|r|0.32*(1.0-r)).collect(),r_d:rd,h_rel:hs.clone()}};
  let nums=|s:f64|Numbers{theta_i:(0..9).map(|i|(i as f64*10.0).to_radians()).collect(),h_rel:hs.clone(),values:(0..189).map(|i|s*(0.02+0.1*((i*7919)%97) as f64/97.0)).collect()};
  let a=vec![Section::Maps(vec![mk("f_{refl}, reflection only",270,true),mk("f_{high}, all other light, σ = 0",270,true)]),Section::Budgets{panels:[0.0,0.3,0.6,0.9,1.2].map(bud).to_vec(),sigma_per_um:0.01},Section::Grids(vec![("Relative L2 error of f_{refl}".into(),nums(1.0)),("Relative L2 error of f_{high}".into(),nums(0.3))])];
  page("polyester: fit against table","preset preview, seed 1, plywave 0.1.0; 30 fibers, R = 60 μm, eta 1.5",&a).save("/tmp/wt/cli_dev_a.png").unwrap();
  let b=vec![Section::Maps(vec![mk("f_{refl}, reflection only",300,false),mk("f_{high}, all other light, σ = 0",300,false)])];
  page("polyester: ply model","preset preview, seed 1",&b).save("/tmp/wt/cli_dev_b.png").unwrap();
}
