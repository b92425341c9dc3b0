//! The simulated world, seen from outside.

use ricochet::results::{Phase, PointStatus};
use ricochet::synth::{Scenario, World};

fn frame(world: &World, index: u64) -> Vec<u8> {
    let mut bytes = vec![0; world.frame_bytes()];
    world.render(index, &mut bytes);
    bytes
}

#[test]
fn dump() {
    if let Ok(dir) = std::env::var("DUMP") {
        let world = World::new(&Scenario::built_in("lacrosse").unwrap()).unwrap();
        for i in [0, 14, 37, 60, 99] {
            let b = frame(&world, i);
            image::save_buffer(format!("{dir}/l{i}.png"), &b, 256, 192, image::ColorType::L8).unwrap();
        }
        let world = World::new(&Scenario::translation(0.37, 0.13, 0.35)).unwrap();
        let b = frame(&world, 0);
        image::save_buffer(format!("{dir}/t0.png"), &b, 512, 512, image::ColorType::L8).unwrap();
        let mut b = b;
        let t = std::time::Instant::now();
        for _ in 0..100 {
            for i in 0..10 {
                world.render(i, &mut b);
            }
        }
        eprintln!("512 {} fps", 1000.0 / t.elapsed().as_secs_f64());
        let t = std::time::Instant::now();
        World::new(&Scenario::translation(0.37, 0.13, 0.35)).unwrap();
        eprintln!("new {} s", t.elapsed().as_secs_f64());
        let _ = (Phase::Flight, PointStatus::Valid);
    }
}
