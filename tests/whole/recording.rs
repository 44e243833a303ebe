//! Options that record more than the points must not change a byte of the points.

use crate::common::{folder, succeed, text};
use std::fs;
use std::path::Path;

/// A flight of two channels of different wavelengths over foliage, with spectra, a receiver with noise,
/// moving optics and errors of navigation: whatever a recording could disturb.
const PIPELINE: &str = "scene = 's.xml'\nassets = ['.']\nseed = 3\n[platform]\nkind = 'linear_path'\n\
    mount = { offset_m = [0, 0, 0], rotate_deg = [{ x = -90 }, { z = 90 }] }\n\
    [scanner]\nid = 'x'\noptics = 'rotating'\nscan_angle_max_deg = 20\nscan_angle_effective_max_deg = 15\nscan_freq_max_hz = 100\n\
    pulse_freqs_hz = [2000]\nbeam_divergence_rad = 0.005\nreceived_energy_min_w = 1e-10\naccuracy_m = 0.02\nwavelength_nm = 1064\n\
    nep_w = 1e-11\nsaturation_w = 1e-7\n\
    [[scanner.channel]]\nid = 'a'\n[[scanner.channel]]\nid = 'b'\nwavelength_nm = 532\n[waveform]\nquality = 4\n\
    [settings]\nscan_freq_hz = 20\nscan_angle_deg = 15\n[navigation_errors]\nposition_m = 0.02\nattitude_deg = 0.01\n\
    [[leg]]\nposition_m = [0, -8, 40]\nspeed_m_per_s = 40\n[[leg]]\nposition_m = [0, 8, 40]\nactive = false\n";

fn write(dir: &Path, element_size: f64) {
    let file = |name: &str, text: &str| fs::write(dir.join(name), text).unwrap();
    file("p.toml", PIPELINE);
    let leaves = format!("newmtl leaves\nhelios_spectra leafy\nvlscan_element_size_m {element_size}\n");
    file("v.mtl", &leaves);
    file("g.mtl", "newmtl g\nhelios_reflectance 0.5\nhelios_classification 2\nhelios_isGround true\n");
    file(
        "g.obj",
        "mtllib g.mtl\nusemtl g\nv -99 -99 -1\nv 99 -99 -1\nv 99 99 -1\nv -99 99 -1\nf 1 2 3\nf 1 3 4\n",
    );
    fs::create_dir_all(dir.join("spectra")).unwrap();
    file("spectra/leafy.txt", &format!("{}0.4 5\n0.532 12\n1.064 48\n1.6 20\n", "header\n".repeat(26)));
    let mut voxels = String::from(
        "VOXEL SPACE\n#min_corner: -10 -10 0\n#max_corner: 10 10 3\n#split: 20 20 3\n#res: 1 #max_pad: 2\n\
         i j k PadBVTotal a b c d e f g h i transmittance l m\n",
    );
    for i in 0..1200 {
        voxels += &format!("{} {} {} 0.4 0 0 0 0 0 0 0 0 0 0.5 0 0\n", i % 20, i / 20 % 20, i / 400);
    }
    file("s.vox", &voxels);
    file(
        "s.xml",
        "<document><scene id=\"s\"><part id=\"1\"><filter type=\"detailedvoxels\">\
         <param type=\"string\" key=\"filepath\" value=\"s.vox\"/><param type=\"string\" key=\"matfile\" value=\"v.mtl\"/></filter></part>\
         <part id=\"2\"><filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"g.obj\"/></filter></part></scene></document>",
    );
}

const COLUMNS: &str = "X,Y,Z,Amplitude,ReturnNumber,NumberOfReturns,GpsTime,Device,PulseNumber,Part";

/// The rows of the points with these columns, written with more options.
fn points(dir: &Path, columns: &str, options: &[&str]) -> Vec<String> {
    let args = ["run", "p.toml", "-q", "--force", "-o", "-", "--format", "csv", "--columns", columns];
    text(&succeed(dir, &[&args, options].concat()).stdout).lines().map(str::to_owned).collect()
}

#[test]
fn no_option_that_only_records_more_changes_a_point() {
    for element_size in [0.0, 0.5] {
        let dir = folder();
        write(dir.path(), element_size);
        let of = |options: &[&str]| points(dir.path(), COLUMNS, options);
        let plain = of(&[]);
        assert!(plain.len() > 1000, "{}", plain.len());
        for options in [
            &["-o", "a.laz", "--waveforms"][..],
            &["-o", "b.laz", "--pulses"],
            &["-o", "c.mcap"],
            &["-o", "d.laz", "--true-positions", "--labels"],
            &["-o", "e.las", "--wave-packets", "inside"],
            &["-o", "f.ply", "--height-above-ground"],
            &["-o", "g.trajectory.csv"],
            &["-o", "h.laz", "--parts", "parts.csv"],
            &["--schedule-log", "log.csv", "--chunk-size", "7"],
        ] {
            assert_eq!(of(options), plain, "{options:?}, elements of {element_size} m");
        }
        // Missed pulses are rows of their own.
        let with_misses: Vec<String> =
            of(&["--misses"]).into_iter().filter(|row| !row.contains(",0,0,")).collect();
        assert_eq!(with_misses, plain, "--misses, elements of {element_size} m");
        // Truth is in further columns.
        let truth =
            "Subray,SurfaceX,NormalX,FootprintFraction,TrueX,ScannerX,HeightAboveGround,Range,TrueRange";
        let with_truth: Vec<String> = points(dir.path(), &format!("{COLUMNS},{truth}"), &[])
            .iter()
            .map(|row| row.split(',').take(COLUMNS.split(',').count()).collect::<Vec<_>>().join(","))
            .collect();
        assert_eq!(with_truth, plain, "truth, elements of {element_size} m");
    }
}

#[test]
fn every_return_of_the_points_has_its_subrays() {
    for element_size in [0.0, 1.0] {
        let dir = folder();
        write(dir.path(), element_size);
        // Noise alone makes returns without a subray.
        let quiet = PIPELINE.replace("nep_w = 1e-11\n", "").replace("saturation_w = 1e-7\n", "");
        fs::write(dir.path().join("p.toml"), quiet).unwrap();
        let share_of = |options: &[&str]| {
            let mut by_return = std::collections::BTreeMap::<String, f64>::new();
            for row in &points(dir.path(), "Device,PulseNumber,ReturnNumber,FootprintFraction", options)[1..]
            {
                let (key, share) = row.rsplit_once(',').unwrap();
                *by_return.entry(key.to_owned()).or_default() += share.parse::<f64>().unwrap();
            }
            by_return
        };
        let (by_points, by_subrays) = (share_of(&[]), share_of(&["--subrays"]));
        assert!(by_points.len() > 1000, "{}", by_points.len());
        for (key, share) in &by_points {
            let other = by_subrays.get(key).copied().unwrap_or(0.0);
            assert!((share - other).abs() < 1e-9, "{element_size} m, return {key}: {share} and {other}");
        }
    }
}

#[test]
fn channels_meet_spectra_at_their_own_wavelengths() {
    let dir = folder();
    write(dir.path(), 0.0);
    fs::write(dir.path().join("m.mtl"), "newmtl m\nhelios_spectra leafy\n").unwrap();
    let wall =
        "mtllib m.mtl\nusemtl m\nv -99 400 -99\nv 99 400 -99\nv 99 400 99\nv -99 400 99\nf 1 2 3\nf 1 3 4\n";
    fs::write(dir.path().join("wall.obj"), wall).unwrap();
    let scan = |wavelengths: &[u32]| {
        let mut text = "scene = 'wall.obj'\nassets = ['.']\n[scanner]\nid = 'x'\noptics = 'line'\nfibres = 1\n\
            scan_angle_max_deg = 1e-9\npulse_freqs_hz = [1000]\nvisibility_km = 1e9\nreceived_energy_min_w = 1e-15\n"
            .to_owned();
        match wavelengths {
            [one] => text += &format!("wavelength_nm = {one}\n"),
            all => {
                for wavelength in all {
                    text +=
                        &format!("[[scanner.channel]]\nid = 'c{wavelength}'\nwavelength_nm = {wavelength}\n");
                }
            }
        }
        text + "[settings]\nmax_duration_s = 0.001\n[[leg]]\nposition_m = [0, 0, 0]\n"
    };
    let amplitudes = |wavelengths: &[u32], options: &[&str]| -> Vec<f64> {
        fs::write(dir.path().join("p.toml"), scan(wavelengths)).unwrap();
        let rows = points(dir.path(), "Amplitude", options);
        rows[1..].iter().map(|row| row.parse().unwrap()).collect()
    };
    let three = amplitudes(&[1064, 532, 1600], &[]);
    let alone: Vec<f64> = [1064, 532, 1600].iter().map(|one| amplitudes(&[*one], &[])[0]).collect();
    assert_eq!(three, alone);
    assert!((three[1] / three[0] - 0.25).abs() < 1e-5 && (three[2] / three[0] - 20.0 / 48.0).abs() < 1e-5);
    // As in HELIOS++, with a warning.
    fs::write(dir.path().join("p.toml"), scan(&[1064, 532])).unwrap();
    let args = ["run", "p.toml", "-o", "-", "--format", "csv", "--columns", "Amplitude", "--correct"];
    let out = succeed(dir.path(), &[&args[..], &["no-channel-spectra"]].concat());
    assert!(text(&out.stderr).contains("at the 1064 nm of the first channel"), "{}", text(&out.stderr));
    let rows = text(&out.stdout);
    let found: Vec<f64> = rows.lines().skip(1).map(|row| row.parse().unwrap()).collect();
    // But for haze, which is thicker at the shorter wavelength.
    assert!((found[1] / found[0] - 1.0).abs() < 1e-6, "{found:?}");
    // A packed scene has the spectra of all channels of the survey that it was packed for.
    fs::write(dir.path().join("p.toml"), scan(&[1064, 532, 1600])).unwrap();
    succeed(dir.path(), &["scene", "pack", "p.toml", "-o", "wall.vlscene", "-q"]);
    assert_eq!(amplitudes(&[1064, 532, 1600], &["--scene", "wall.vlscene"]), alone);
    fs::write(dir.path().join("p.toml"), scan(&[1064, 905])).unwrap();
    let refused =
        crate::common::run(dir.path(), &["run", "p.toml", "--scene", "wall.vlscene", "-o", "x.laz"]);
    assert!(text(&refused.stderr).contains("wavelengths of all channels"), "{}", text(&refused.stderr));
}
