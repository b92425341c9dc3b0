//! The order in which a command takes the images of a sequence.

use crate::import::Order;

/// The option for the order of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::Args)]
pub struct ImageOrder {
    /// Take the images of a sequence in reverse order.
    #[arg(long)]
    pub reverse: bool,
}

impl ImageOrder {
    /// Returns the order of the images.
    pub fn order(self) -> Order {
        if self.reverse { Order::Reversed } else { Order::Forward }
    }
}
