//! Refractive index of water.
