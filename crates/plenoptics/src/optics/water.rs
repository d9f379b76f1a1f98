//! The refractive index of water after Quan and Fry (Applied Optics 34, 3477, 1995), relative to air.

use std::ops::RangeInclusive;

/// Temperatures the formula holds for, °C.
pub const TEMPERATURE_C: RangeInclusive<f64> = 0.0..=30.0;
/// Salinities the formula holds for, ‰.
pub const SALINITY_PERMILLE: RangeInclusive<f64> = 0.0..=35.0;
/// Wavelengths in vacuum the formula holds for, nm.
pub const WAVELENGTH_NM: RangeInclusive<f64> = 400.0..=700.0;

/// A condition of the water that the formula does not hold for.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{quantity} of {value} {unit} is outside the {low} to {high} {unit} that the water's index is known for")]
pub struct OutOfRange {
    /// What is out of range: temperature, salinity or wavelength.
    pub quantity: &'static str,
    /// The value given.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Least value the formula holds for.
    pub low: f64,
    /// Greatest value the formula holds for.
    pub high: f64,
}

/// Whether a temperature (°C) is one the formula holds for.
///
/// # Errors
/// [`OutOfRange`] with the range.
pub fn check_temperature(temperature_c: f64) -> Result<(), OutOfRange> {
    check("a temperature", temperature_c, "°C", &TEMPERATURE_C)
}

/// Whether a salinity (‰) is one the formula holds for.
///
/// # Errors
/// [`OutOfRange`] with the range.
pub fn check_salinity(salinity_permille: f64) -> Result<(), OutOfRange> {
    check("a salinity", salinity_permille, "‰", &SALINITY_PERMILLE)
}

/// Whether a wavelength (nm, in vacuum) is one the formula holds for.
///
/// # Errors
/// [`OutOfRange`] with the range.
pub fn check_wavelength(wavelength_nm: f64) -> Result<(), OutOfRange> {
    check("a wavelength", wavelength_nm, "nm", &WAVELENGTH_NM)
}

fn check(
    quantity: &'static str,
    value: f64,
    unit: &'static str,
    range: &RangeInclusive<f64>,
) -> Result<(), OutOfRange> {
    if range.contains(&value) {
        Ok(())
    } else {
        Err(OutOfRange { quantity, value, unit, low: *range.start(), high: *range.end() })
    }
}

/// n_water at a temperature (°C), salinity (‰) and wavelength in vacuum (nm), relative to air.
///
/// # Errors
/// [`OutOfRange`] for a condition that the formula does not hold for, NaN among them.
pub fn refractive_index(temperature_c: f64, salinity_permille: f64, wavelength_nm: f64) -> Result<f64, OutOfRange> {
    check_temperature(temperature_c)?;
    check_salinity(salinity_permille)?;
    check_wavelength(wavelength_nm)?;
    let (t, s, l) = (temperature_c, salinity_permille, wavelength_nm);
    // Coefficients n0 to n9 of Quan and Fry's Eq. 3.
    Ok(1.31405 + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s - 2.02e-6 * t * t
        + (15.868 + 0.01155 * s - 0.00423 * t) / l
        - 4382.0 / (l * l)
        + 1.1455e6 / (l * l * l))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sodium_light_in_fresh_and_sea_water() {
        assert!((refractive_index(20.0, 0.0, 589.3).unwrap() - 1.333_004).abs() < 5e-7);
        assert!((refractive_index(20.0, 35.0, 589.3).unwrap() - 1.339_406).abs() < 5e-7);
    }

    #[test]
    fn conditions_beyond_the_formula_are_refused_by_name() {
        for (t, s, l, word) in [
            (-0.1, 0.0, 500.0, "temperature"),
            (30.1, 0.0, 500.0, "temperature"),
            (20.0, 35.1, 500.0, "salinity"),
            (20.0, -1.0, 500.0, "salinity"),
            (20.0, 0.0, 399.0, "wavelength"),
            (20.0, 0.0, f64::NAN, "wavelength"),
        ] {
            let refusal = refractive_index(t, s, l).unwrap_err();
            assert!(refusal.to_string().contains(word), "{refusal}");
        }
    }
}
