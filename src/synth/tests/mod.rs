//! The judge of the renderer: a slow, plain twin of it.

mod reference_renderer;
