//! Maximum ranges of the catalogue's instruments in the refined physics, compared with their data sheets.

use super::*;
use vlscan_survey::{Scanner, catalogue};

/// Instruments by the ids of their entries | pulse rate (Hz), reflectance of an extended target, maximum
/// range (m) | source of these figures, or the reason that they are missing.
const PUBLISHED: &str = "\
riegl_vz400 | 100000 0.9 600, 100000 0.2 280, 300000 0.9 350, 300000 0.2 160 | RIEGL VZ-400, data sheet: long range mode 100 kHz, high speed mode 300 kHz
riegl_vz1000 | 70000 0.9 1400, 70000 0.2 700, 100000 0.9 1200, 150000 0.9 950 | RIEGL VZ-1000, data sheet
riegl_vz2000i | 50000 0.9 2500, 50000 0.2 1300 | RIEGL VZ-2000i, data sheet
riegl_vz600i | 140000 0.9 1000 | RIEGL VZ-600i, data sheet: 1000 m at 140 kHz
riegl_vq-450 | 150000 0.8 800, 150000 0.1 300 | RIEGL VQ-450, data sheet: 800 m at 150 kHz and 80 %, 300 m at 10 %
riegl_lms-q560 | 100000 0.2 850, 100000 0.6 1500 | RIEGL LMS-Q560, data sheet
riegl_lms-q780 | 100000 0.2 4100, 100000 0.6 5800, 200000 0.2 3500, 200000 0.6 5100 | RIEGL LMS-Q780, data sheet
riegl_vux-1uav | 50000 0.2 550, 50000 0.6 920, 100000 0.2 400, 100000 0.6 660, 200000 0.6 480, 550000 0.2 170, 550000 0.6 300 | RIEGL VUX-1UAV, data sheet
riegl_vux-1uav22 | 50000 0.8 1415 | RIEGL VUX-1UAV22, data sheet
riegl_minivux-3uav | 100000 0.8 330 | RIEGL miniVUX-3UAV, data sheet: 330 m at 100 kHz and 80 %
riegl_vux-1ha22 | 300000 0.8 475 | RIEGL VUX-1HA22, data sheet
optech_3100 | 33000 0.2 3500 | Optech ALTM 3100, data sheet: operating altitude 80 to 3500 m, taken for 33 kHz and 20 %
optech_galaxy | 35000 0.2 4700 | Teledyne Optech Galaxy, data sheet: operating altitude 150 to 4700 m, taken for 35 kHz and 20 %
livox_mid-40 livox_mid-70 livox-mid-100 livox-mid-100a livox-mid-100b livox-mid-100c livox_mid-100 | 100000 0.1 90, 100000 0.2 130, 100000 0.8 260 | Livox Mid-40, Mid-70 and Mid-100, user manuals: 100 klx
livox-avia-non-repetitive | 40000 0.1 190, 40000 0.2 260, 40000 0.8 450 | Livox Avia, user manual: 0 klx
dji-zenmuse-l1-non-repetitive | 40000 0.8 450, 40000 0.1 190 | DJI Zenmuse L1, specifications: 450 m at 80 % and 0 klx, 190 m at 10 % and 100 klx
dji-zenmuse-l2-repetitive dji-zenmuse-l2-non-repetitive | 40000 0.5 450, 40000 0.1 250 | DJI Zenmuse L2, specifications: 450 m at 50 % and 0 klx, 250 m at 10 % and 100 klx; the entry lies between
velodyne_hdl-64e | 20833 0.8 120, 20833 0.1 50 | Velodyne HDL-64E, data sheet: 120 m for cars and foliage (0.8), 50 m for pavement (0.1)
vlp16 | 18750 0.8 100 | Velodyne VLP-16, data sheet: up to 100 m, no reflectance stated; the entry's range gate alone
ouster_os0-128 | 10240 0.1 20, 10240 0.8 50 | Ouster OS0, data sheet of revision 6: 1024 columns at 10 Hz, 100 klx, detection probability above 50 %
ouster_os1-128 | 10240 0.1 55, 10240 0.8 120 | Ouster OS1, data sheet of revision 6: as above; the entry lies between
ouster_os2-128 | 10240 0.1 100, 10240 0.8 240 | Ouster OS2, data sheet of revision 6: as above; the entry lies between
ouster_os0-128-rev7 | 10240 0.1 42, 10240 0.8 91 | Ouster OS0, data sheet of revision 7: 35 and 75 m with a detection probability of 90 %, which are 1/1.213 of these at 8 photons; the entry lies between
ouster_os1-128-rev7 | 10240 0.1 109, 10240 0.8 206 | Ouster OS1, data sheet of revision 7: 90 and 170 m, as above; the entry's range gate ends at 233 m
ouster_os2-128-rev7 | 10240 0.1 243, 10240 0.8 425 | Ouster OS2, data sheet of revision 7: 200 and 350 m, as above; the entry's range gate ends at 404 m
hesai_xt32 | 20000 0.1 80 | Hesai PandarXT-32, specifications: 80 m at 10 %
hesai_xt16 | 20000 0.1 80 | Hesai PandarXT-16, user manual: 80 m at 10 % within 7 degrees of the horizontal
livox_hap | 452000 0.1 150 | Livox HAP, user manual: 150 m at 10 % and 100 klx
livox_mid-360 | 200000 0.1 40, 200000 0.8 70 | Livox Mid-360, data sheet: 40 m at 10 %, 70 m at 80 %
leica_als50 leica_als50-ii optech_2033 | | flying heights alone are published, without reflectance; the entries are left as they are
riegl_vq_780i riegl_vq-1560i riegl_vq-880g riegl_vq-880g-infrared | | no figures at hand that are certain; the entries are left as they are
riegl_vq-1560ii riegl_vq-840-g riegl_vq-840-gl velodyne_hdl-32e hesai_pandar128 hesai_xt32m2x leica_rtc360 leica_blk360 leica_blk360-g2 riegl_vz400i riegl_vux-120 velodyne_alpha_prime velodyne_vlp-32c hovermap | | no figures at hand that are certain; the entries have range gates alone
tractorscanner panoscanner | | prototypes without a data sheet; the entries are left as they are";

/// Distance of the farthest wall of that reflectance that the scanner's first device detects at a pulse rate,
/// m.
fn max_range(scanner: &Scanner, pulse_freq: u32, reflectance: f64) -> f64 {
    let mut survey = survey(vec![scanner.devices[0].clone()]);
    // Every echo at the threshold, not every other.
    survey.scanner.devices[0].receiver.threshold_photons = None;
    survey.scanner.pulse_freqs.clone_from(&scanner.pulse_freqs);
    survey.legs[0].scanner.pulse_freq = pulse_freq;
    let is_seen = |range: f64| {
        let scene = rectangles(Material { reflectance, ..half_white() }, &[wall(-20.0, 20.0, range)]);
        !simulate(&scene, &survey, PhysicsOptions::refined()).echoes.is_empty()
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
        let id = scanner.id.as_str();
        let row = PUBLISHED.lines().find(|row| row.split('|').next().unwrap().split(' ').any(|i| i == id));
        let row: Vec<&str> =
            row.unwrap_or_else(|| panic!("{id} is missing")).split('|').map(str::trim).collect();
        let figures: Vec<&str> = row[1].split(',').filter(|f| !f.is_empty()).collect();
        for figure in &figures {
            let numbers: Vec<f64> = figure.split_whitespace().map(|n| n.parse().unwrap()).collect();
            let [pulse_freq, reflectance, range] = numbers[..] else { panic!("{figure}") };
            let found = max_range(scanner, pulse_freq as u32, reflectance);
            assert!(
                (found / range - 1.0).abs() <= 0.15,
                "{id} at {pulse_freq} Hz and {reflectance}: {found:.0} m, not {range} m ({})",
                row[2]
            );
        }
        // All channels have the maximum range of the first.
        let first = scanner.devices[0].receiver.max_range;
        assert!(scanner.devices.iter().all(|d| d.receiver.max_range == first), "{id}");
        assert!(first.is_some() || figures.is_empty() || id == "vlp16", "{id}");
    }
}
