//! Refractive index of water.

use crate::Water;

/// Salinity of the sea-water coefficients, per mille.
const SEA_SALINITY: f64 = 35.0;
/// Coefficients a..e of n = a T^2 + b L^2 + c T + d L + e (T in degrees Celsius, L in nm).
const FRESH: [f64; 5] = [-1.97812e-6, 1.03223e-7, -8.58125e-6, -1.54834e-4, 1.38919];
const SEA: [f64; 5] = [-1.50156e-6, 1.07085e-7, -4.27594e-5, -1.60476e-4, 1.39807];

impl Water {
    /// Refractive index: Parrish's 2020 fit to the data of Austin and Halikas, linear in salinity between fresh and sea
    /// water. Its rms error is 2e-4 over 0 to 30 degrees Celsius and 400 to 700 nm.
    pub fn index(&self) -> f64 {
        let (t, l) = (self.temperature_c, self.wavelength_nm);
        let [fresh, sea] = [FRESH, SEA].map(|[a, b, c, d, e]| (a * t + c) * t + (b * l + d) * l + e);
        fresh + (sea - fresh) * self.salinity / SEA_SALINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(temperature_c: f64, salinity: f64) -> f64 {
        Water { temperature_c, salinity, wavelength_nm: 532.0 }.index()
    }

    #[test]
    fn index_at_532_nm_matches_the_published_figures() {
        for (temperature, fresh, sea) in [(5.0, 1.3359, 1.3428), (12.0, 1.3357, 1.3423), (20.0, 1.3351, 1.3416)] {
            assert!((index(temperature, 0.0) - fresh).abs() < 6e-5);
            assert!((index(temperature, 35.0) - sea).abs() < 6e-5);
        }
    }

    #[test]
    fn index_is_linear_in_salinity() {
        let middle = 0.5 * (index(12.0, 0.0) + index(12.0, 35.0));
        assert!((index(12.0, 17.5) - middle).abs() < 1e-12);
    }
}
