//! Ground truth: simulated impacts, drawn without any interpolation of pictures.
