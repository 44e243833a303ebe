//! How a surface reflects (spec pulse-physics §3.2).

/// A material with its reflectance already resolved for the scanner's wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in its MTL file.
    pub name: String,
    /// ρ as it enters the energy computation: `helios_reflectance` verbatim, otherwise per cent (0–100), 50 by default.
    pub reflectance: f64,
    /// Angular law.
    pub reflection: Reflection,
    /// Point class of its echoes.
    pub classification: i32,
    /// Legs and parts may be placed on it.
    pub is_ground: bool,
}

/// Angular law of reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reflection {
    /// ρ whatever the angle (no Kd, no Ks).
    Uniform,
    /// ρ·cos θ (Kd only).
    Lambert,
    /// ρ·[(1−s) + s·|cos 2θ|^N / cos θ]·cos θ (Kd and Ks).
    Phong {
        /// Specular share s, 0–1.
        specularity: f64,
        /// Exponent N.
        exponent: f64,
    },
}

impl Material {
    /// A material that no file describes: 50 per cent whatever the angle.
    pub fn unnamed(name: &str) -> Material {
        Material {
            name: name.to_owned(),
            reflectance: 50.0,
            reflection: Reflection::Uniform,
            classification: 0,
            is_ground: false,
        }
    }

    /// Reflectance factor f(θ) for the cosine of the incidence angle, `0 ≤ cos θ ≤ 1`.
    pub fn factor(&self, cosine: f64) -> f64 {
        match self.reflection {
            Reflection::Uniform => self.reflectance,
            Reflection::Lambert => self.reflectance * cosine,
            Reflection::Phong { specularity: s, exponent } => {
                let lobe = libm::pow((2.0 * cosine * cosine - 1.0).abs(), exponent);
                // cos θ cancels, so a grazing hit stays finite.
                self.reflectance * ((1.0 - s) * cosine + s * lobe)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_of_the_worked_example() {
        // spec pulse-physics §3.6: ρ = 0.5 at 30° and 60°
        let with = |reflection| Material { reflectance: 0.5, reflection, ..Material::unnamed("m") };
        let (c30, c60) = (3f64.sqrt() / 2.0, 0.5);
        let phong = with(Reflection::Phong { specularity: 0.5, exponent: 10.0 });
        assert!((with(Reflection::Lambert).factor(c30) - 0.433012702).abs() < 1e-9);
        assert!((phong.factor(c30) - 0.216750492).abs() < 1e-9);
        assert!((phong.factor(c60) - 0.125244141).abs() < 1e-9);
        assert_eq!(with(Reflection::Uniform).factor(c60), 0.5);
    }
}
