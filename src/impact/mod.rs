//! Collisions: when contact begins and ends, and what it did to the body.
