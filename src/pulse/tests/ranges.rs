//! Maximum ranges of the catalogue's instruments in refined physics against those that their data sheets state.

use super::*;
use crate::pulse::{Physics, PulseSimulator};
use crate::survey::{Scanner, catalogue};

/// Figures of an instrument.
struct Published {
    /// Ids of the entries that they are for.
    ids: &'static [&'static str],
    /// Where they stand, or why there are none.
    source: &'static str,
    /// Pulse rate (Hz), reflectance of an extended target, maximum range (m).
    figures: &'static [(u32, f64, f64)],
}

const PUBLISHED: &[Published] = &[
    Published {
        ids: &["riegl_vz400"],
        source: "RIEGL VZ-400, data sheet: long range mode 100 kHz, high speed mode 300 kHz",
        figures: &[
            (100_000, 0.9, 600.0),
            (100_000, 0.2, 280.0),
            (300_000, 0.9, 350.0),
            (300_000, 0.2, 160.0),
        ],
    },
    Published {
        ids: &["riegl_vz1000"],
        source: "RIEGL VZ-1000, data sheet",
        figures: &[
            (70_000, 0.9, 1400.0),
            (70_000, 0.2, 700.0),
            (100_000, 0.9, 1200.0),
            (150_000, 0.9, 950.0),
        ],
    },
    Published {
        ids: &["riegl_vz2000i"],
        source: "RIEGL VZ-2000i, data sheet",
        figures: &[(50_000, 0.9, 2500.0), (50_000, 0.2, 1300.0)],
    },
    Published {
        ids: &["riegl_vz600i"],
        source: "RIEGL VZ-600i, data sheet: 1000 m at 140 kHz",
        figures: &[(140_000, 0.9, 1000.0)],
    },
    Published {
        ids: &["riegl_vq-450"],
        source: "RIEGL VQ-450, data sheet: 800 m at 150 kHz and 80 %, 300 m at 10 %",
        figures: &[(150_000, 0.8, 800.0), (150_000, 0.1, 300.0)],
    },
    Published {
        ids: &["riegl_lms-q560"],
        source: "RIEGL LMS-Q560, data sheet",
        figures: &[(100_000, 0.2, 850.0), (100_000, 0.6, 1500.0)],
    },
    Published {
        ids: &["riegl_lms-q780"],
        source: "RIEGL LMS-Q780, data sheet",
        figures: &[
            (100_000, 0.2, 4100.0),
            (100_000, 0.6, 5800.0),
            (200_000, 0.2, 3500.0),
            (200_000, 0.6, 5100.0),
        ],
    },
    Published {
        ids: &["riegl_vux-1uav"],
        source: "RIEGL VUX-1UAV, data sheet",
        figures: &[
            (50_000, 0.2, 550.0),
            (50_000, 0.6, 920.0),
            (100_000, 0.2, 400.0),
            (100_000, 0.6, 660.0),
            (200_000, 0.6, 480.0),
            (550_000, 0.2, 170.0),
            (550_000, 0.6, 300.0),
        ],
    },
    Published {
        ids: &["riegl_vux-1uav22"],
        source: "RIEGL VUX-1UAV22, data sheet",
        figures: &[(50_000, 0.8, 1415.0)],
    },
    Published {
        ids: &["riegl_vux-1ha22"],
        source: "RIEGL VUX-1HA22, data sheet",
        figures: &[(300_000, 0.8, 475.0)],
    },
    Published {
        ids: &["optech_3100"],
        source: "Optech ALTM 3100, data sheet: operating altitude 80 to 3500 m, taken for 33 kHz and 20 %",
        figures: &[(33_000, 0.2, 3500.0)],
    },
    Published {
        ids: &["optech_galaxy"],
        source: "Teledyne Optech Galaxy, data sheet: operating altitude 150 to 4700 m, taken for 35 kHz and 20 %",
        figures: &[(35_000, 0.2, 4700.0)],
    },
    Published {
        ids: &["livox_mid-40", "livox_mid-70", "livox-mid-100", "livox_mid-100"],
        source: "Livox Mid-40, Mid-70 and Mid-100, user manuals: 100 klx",
        figures: &[(100_000, 0.1, 90.0), (100_000, 0.2, 130.0), (100_000, 0.8, 260.0)],
    },
    Published {
        ids: &["livox-avia-non-repetitive"],
        source: "Livox Avia, user manual: 0 klx",
        figures: &[(40_000, 0.1, 190.0), (40_000, 0.2, 260.0), (40_000, 0.8, 450.0)],
    },
    Published {
        ids: &["dji-zenmuse-l1-non-repetitive"],
        source: "DJI Zenmuse L1, specifications: 450 m at 80 % and 0 klx, 190 m at 10 % and 100 klx",
        figures: &[(40_000, 0.8, 450.0), (40_000, 0.1, 190.0)],
    },
    Published {
        ids: &["dji-zenmuse-l2-repetitive", "dji-zenmuse-l2-non-repetitive"],
        source: "DJI Zenmuse L2, specifications: 450 m at 50 % and 0 klx, 250 m at 10 % and 100 klx; the entry lies between",
        figures: &[(40_000, 0.5, 450.0), (40_000, 0.1, 250.0)],
    },
    Published {
        ids: &["velodyne_hdl-64e"],
        source: "Velodyne HDL-64E, data sheet: 120 m for cars and foliage (0.8), 50 m for pavement (0.1)",
        figures: &[(20_833, 0.8, 120.0), (20_833, 0.1, 50.0)],
    },
    Published {
        ids: &["vlp16"],
        source: "Velodyne VLP-16, data sheet: up to 100 m, no reflectance stated; the entry's range gate alone",
        figures: &[(18_750, 0.8, 100.0)],
    },
    Published {
        ids: &["leica_als50", "leica_als50-ii", "optech_2033"],
        source: "flying heights alone are published, without reflectance; the entries are left as they are",
        figures: &[],
    },
    Published {
        ids: &["riegl_vq_780i", "riegl_vq-1560i", "riegl_vq-880g", "riegl_vq-880g-infrared"],
        source: "no figures at hand that are certain; the entries are left as they are",
        figures: &[],
    },
    Published {
        ids: &["tractorscanner", "panoscanner"],
        source: "prototypes without a data sheet; the entries are left as they are",
        figures: &[],
    },
];

/// The farthest wall of that reflectance that the scanner's first device detects at a pulse rate, m.
fn max_range(scanner: &Scanner, pulse_freq: u32, reflectance: f64) -> f64 {
    let mut survey = survey(vec![scanner.devices[0].clone()]);
    survey.scanner.pulse_freqs.clone_from(&scanner.pulse_freqs);
    survey.legs[0].scanner.pulse_freq = pulse_freq;
    let is_seen = |range: f64| {
        let scene = rectangles(Material { reflectance, ..half_white() }, &[wall(-20.0, 20.0, range)]);
        let tree = tree(&scene);
        let physics = Physics::new(&scene, &tree, &survey, PhysicsOptions::refined()).unwrap();
        let mut batch = Batch::default();
        PulseSimulator::new(&physics)
            .simulate(0, &[in_frame(&scene, &pulse(Rotation::IDENTITY))], &mut batch)
            .unwrap();
        !batch.echoes.is_empty()
    };
    let (mut near, mut far) = (scanner.devices[0].detector.range_min.max(1.0), 20_000.0);
    while far - near > 0.5 {
        let middle = 0.5 * (near + far);
        if is_seen(middle) { near = middle } else { far = middle }
    }
    near
}

#[test]
fn instruments_see_as_far_as_their_data_sheets_say() {
    let (catalogue, _) = catalogue().unwrap();
    for (_, scanner) in &catalogue.scanners {
        let of_id = PUBLISHED.iter().find(|p| p.ids.contains(&scanner.id.as_str()));
        let published = of_id.unwrap_or_else(|| panic!("{} is missing", scanner.id));
        for &(pulse_freq, reflectance, range) in published.figures {
            let found = max_range(scanner, pulse_freq, reflectance);
            assert!(
                (found / range - 1.0).abs() <= 0.15,
                "{} at {pulse_freq} Hz and {reflectance}: {found:.0} m, not {range} m ({})",
                scanner.id,
                published.source
            );
        }
        // All channels see as far as the first.
        let first = scanner.devices[0].receiver.max_range;
        assert!(scanner.devices.iter().all(|d| d.receiver.max_range == first), "{}", scanner.id);
        assert!(first.is_some() || published.figures.is_empty() || scanner.id == "vlp16", "{}", scanner.id);
    }
}
