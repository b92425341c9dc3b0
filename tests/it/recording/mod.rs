//! Recordings: written, damaged, recovered and read.

mod camera;
mod compressed;
mod container;
pub mod damage;
mod export;
mod extract;
pub mod film;
pub mod foreign;
mod killed;
mod lies;
pub mod mutation;
mod node;
mod power_cut;
mod python;
pub mod recover;
mod rerun;
mod roundtrip;
pub mod samples;
mod seek;
mod speed;
mod split;
