//! Reflectance and transmittance of common surfaces at the wavelengths of lidars, for materials that name
//! them as their spectrum. A file of the same name in an asset folder comes first. docs/dev/light.md lists
//! the values and their sources.

/// A surface of the library.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSpectrum {
    /// Name, by which materials find it.
    pub name: &'static str,
    /// Wavelengths, nm, ascending, with the reflectance and the transmittance there, 0 to 1. The
    /// transmittance is that of a single leaf, and 0 for others. Echoes do not depend on it.
    pub values: &'static [(f64, f64, f64)],
}

/// All surfaces of the library.
pub const SURFACE_SPECTRA: &[SurfaceSpectrum] = &[
    // Quercus crispula, leaves in summer, mean of the files of Noda et al. (JaLTER ERDP-2013-02); 1064 nm
    // from 905 nm by the ratio in Quercus_leaf_sun_2010_0802_2.
    SurfaceSpectrum {
        name: "broadleaf",
        values: &[
            (532.0, 0.097, 0.167),
            (905.0, 0.409, 0.567),
            (1064.0, 0.404, 0.583),
            (1550.0, 0.247, 0.442),
        ],
    },
    // Picea, needles in summer, mean of the files of the same data set; 905 nm from 1064 nm by the ratio in
    // Picea_leaf__2011_0629_1.
    SurfaceSpectrum {
        name: "needle",
        values: &[
            (532.0, 0.098, 0.078),
            (905.0, 0.378, 0.445),
            (1064.0, 0.378, 0.451),
            (1550.0, 0.147, 0.156),
        ],
    },
    // Quercus crispula, Quercus_trunk__2010_0803_3 of the same data set.
    SurfaceSpectrum {
        name: "bark",
        values: &[
            (532.0, 0.205, 0.0),
            (830.0, 0.404, 0.0),
            (865.0, 0.417, 0.0),
            (905.0, 0.436, 0.0),
            (1064.0, 0.497, 0.0),
            (1310.0, 0.585, 0.0),
            (1550.0, 0.567, 0.0),
        ],
    },
    // PROSPECT-D with N 1.5, chlorophyll 40 and carotenoids 8 µg/cm², water 0.01 and dry matter 0.009 g/cm².
    SurfaceSpectrum {
        name: "grass",
        values: &[
            (532.0, 0.151, 0.147),
            (830.0, 0.443, 0.474),
            (905.0, 0.441, 0.474),
            (1064.0, 0.437, 0.478),
            (1310.0, 0.400, 0.461),
            (1550.0, 0.267, 0.339),
        ],
    },
    // The dry soil of PROSAIL.
    SurfaceSpectrum {
        name: "soil",
        values: &[
            (532.0, 0.250, 0.0),
            (830.0, 0.401, 0.0),
            (905.0, 0.427, 0.0),
            (1064.0, 0.465, 0.0),
            (1310.0, 0.499, 0.0),
            (1550.0, 0.508, 0.0),
        ],
    },
    // Albedo by TARTES of deep snow of the specific surface area 20 m²/kg.
    SurfaceSpectrum {
        name: "snow",
        values: &[
            (532.0, 0.984, 0.0),
            (830.0, 0.896, 0.0),
            (865.0, 0.872, 0.0),
            (905.0, 0.835, 0.0),
            (1047.0, 0.687, 0.0),
            (1064.0, 0.708, 0.0),
            (1310.0, 0.453, 0.0),
            (1550.0, 0.058, 0.0),
        ],
    },
    // Asphalt GDS376 (old black road), concrete GDS375 (light grey road) and brick GDS350 (dark red) of the
    // USGS spectral library 7 (Kokaly et al. 2017, Data Series 1035).
    SurfaceSpectrum {
        name: "asphalt",
        values: &[(532.0, 0.08, 0.0), (905.0, 0.13, 0.0), (1064.0, 0.14, 0.0), (1550.0, 0.19, 0.0)],
    },
    SurfaceSpectrum {
        name: "concrete",
        values: &[(532.0, 0.27, 0.0), (905.0, 0.31, 0.0), (1064.0, 0.31, 0.0), (1550.0, 0.33, 0.0)],
    },
    SurfaceSpectrum {
        name: "roof_tile",
        values: &[(532.0, 0.06, 0.0), (905.0, 0.21, 0.0), (1064.0, 0.25, 0.0), (1550.0, 0.25, 0.0)],
    },
    // Fresnel's reflectance of the surface at normal incidence: indices 1.3346, 1.3282 and 1.3179.
    SurfaceSpectrum {
        name: "water",
        values: &[(532.0, 0.0205, 0.0), (905.0, 0.0199, 0.0), (1550.0, 0.0188, 0.0)],
    },
];

impl SurfaceSpectrum {
    /// The surface of a name.
    pub fn find(name: &str) -> Option<&'static SurfaceSpectrum> {
        SURFACE_SPECTRA.iter().find(|surface| surface.name == name)
    }

    /// The names of all surfaces.
    pub fn names() -> String {
        SURFACE_SPECTRA.iter().map(|surface| surface.name).collect::<Vec<_>>().join(", ")
    }

    /// Wavelengths of the first and the last value, nm, beyond which these hold.
    pub fn range(&self) -> (f64, f64) {
        let at = |value: Option<&(f64, f64, f64)>| value.map_or(0.0, |value| value.0);
        (at(self.values.first()), at(self.values.last()))
    }

    /// Reflectance at a wavelength, nm, linear between values.
    pub fn reflectance(&self, wavelength_nm: f64) -> f64 {
        self.at(wavelength_nm, |value| value.1)
    }

    /// Transmittance at a wavelength, nm, linear between values.
    pub fn transmittance(&self, wavelength_nm: f64) -> f64 {
        self.at(wavelength_nm, |value| value.2)
    }

    fn at(&self, wavelength_nm: f64, of: impl Fn(&(f64, f64, f64)) -> f64) -> f64 {
        let next = self.values.partition_point(|value| value.0 <= wavelength_nm);
        match (next.checked_sub(1).and_then(|last| self.values.get(last)), self.values.get(next)) {
            (Some(a), Some(b)) => of(a) + (of(b) - of(a)) * (wavelength_nm - a.0) / (b.0 - a.0),
            (Some(only), None) | (None, Some(only)) => of(only),
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_conserve_energy_and_are_ordered() {
        for surface in SURFACE_SPECTRA {
            assert_eq!(surface.range(), (532.0, 1550.0), "{}", surface.name);
            assert!(surface.values.windows(2).all(|w| w[0].0 < w[1].0), "{}", surface.name);
            assert!(surface.values.iter().all(|v| v.1 > 0.0 && v.2 >= 0.0 && v.1 + v.2 < 1.0));
        }
        assert_eq!(SURFACE_SPECTRA.len(), 10);
    }

    #[test]
    fn values_are_linear_between_and_hold_beyond() {
        let leaf = SurfaceSpectrum::find("broadleaf").unwrap();
        assert_eq!((leaf.reflectance(905.0), leaf.transmittance(905.0)), (0.409, 0.567));
        assert!((leaf.reflectance(718.5) - 0.253).abs() < 1e-12);
        assert_eq!((leaf.reflectance(400.0), leaf.reflectance(2000.0)), (0.097, 0.247));
        assert!(SurfaceSpectrum::find("leaf").is_none());
    }

    /// Measured ranges of four genera (JaLTER ERDP-2013-02), widened by 5 %.
    #[test]
    fn leaves_lie_within_the_measured_ranges() {
        for (nm, reflectance, transmittance) in [
            (532.0, 0.08..=0.16, 0.08..=0.17),
            (905.0, 0.38..=0.49, 0.45..=0.57),
            (1064.0, 0.38..=0.49, 0.45..=0.58),
            (1550.0, 0.15..=0.29, 0.16..=0.44),
        ] {
            for name in ["broadleaf", "needle"] {
                let surface = SurfaceSpectrum::find(name).unwrap();
                for (value, range) in
                    [(surface.reflectance(nm), &reflectance), (surface.transmittance(nm), &transmittance)]
                {
                    let wide = range.start() * 0.95..=range.end() * 1.05;
                    assert!(wide.contains(&value), "{name} at {nm} nm: {value}");
                }
            }
        }
    }
}
