//! The GenICam back end against a camera of our own on a loopback address, which does what no imitation of the
//! library does: sends again, sends chunk data and ids of 64 bits, mixes up, repeats, cuts off and lies.

mod camera;
mod chunks;
mod control;
mod frames;
mod hostile;
mod mutation;
mod packets;
mod take;
