//! The GenICam back end against a camera of our own on a loopback address. Unlike the library's imitation it resends
//! packets, sends chunk data and 64-bit block ids, and reorders, repeats, truncates and falsifies packets.

mod camera;
mod chunks;
mod control;
mod frames;
mod hostile;
mod mutation;
mod packets;
mod take;
