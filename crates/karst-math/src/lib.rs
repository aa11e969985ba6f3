#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

mod azimuth;
mod div;
mod horner;
mod reciprocal;
mod round;
mod sqrt;
mod words;

pub use azimuth::azimuth;
pub use div::{div_round, div_round_unsigned};
pub use horner::{
    COEFFICIENT_FRAC_BITS, DERIVATIVE_FRAC_BITS, RADIUS_FRAC_BITS, horner, horner_with_derivative,
    horner_with_derivative_short,
};
pub use reciprocal::{
    high_product, high_product_of_signed, high_product_signed, normalise, reciprocal, reciprocal_coarse,
};
pub use round::{round_product, round_shift, round_transform, round_transform_short, saturate_bits, saturate_i32};
pub use sqrt::{hypot, hypot_short, sqrt_floor, sqrt_floor_normalised, sqrt_round};

#[cfg(test)]
extern crate std;
