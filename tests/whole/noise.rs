//! Noise of a whole run: every source has the distribution asked for, repeats none of the others, and does
//! not depend on threads. The scene is a wall, so that each source can be seen in the output.

use crate::common::{folder, succeed, text};
use std::fs;

const WALL: &str = "v -900 50 -900\nv 900 50 -900\nv 900 50 900\nv -900 50 900\nv 0 60 0\nv 1 60 0\nv 0 61 1\n\
                    f 1 2 3\nf 1 3 4\nf 5 6 7\n";

/// Lines of a file as numbers.
type Table = Vec<Vec<f64>>;

/// Points, pulses and waveforms of 2000 pulses at a wall 50 m away.
fn run(extra: &[&str], accuracy: &str, noise: &str) -> [Table; 3] {
    let dir = folder();
    fs::write(dir.path().join("wall.obj"), WALL).unwrap();
    let survey = format!(
        r#"<?xml version="1.0"?><document>
<scene id="s"><part id="1"><filter type="objloader"><param type="string" key="filepath" value="wall.obj"/></filter></part></scene>
<platform id="p" type="static">{noise}<scannerMount x="0" y="0" z="0"/></platform>
<scanner id="i" optics="line" numFibers="1" accuracy_m="{accuracy}" beamDivergence_rad="0.0003" pulseFreqs_Hz="2000"
  pulseLength_ns="4" rangeMin_m="1" scanAngleMax_deg="0" scanFreqMin_Hz="0" scanFreqMax_Hz="0" wavelength_nm="1064">
  <FWFSettings beamSampleQuality="1"/><beamOrigin x="0" y="0" z="0"/></scanner>
<survey name="n" scene="s" platform="p" scanner="i">
  <leg><platformSettings x="0" y="0" z="0"/><scannerSettings active="true" pulseFreq_hz="2000" maxDuration_s="1"/></leg>
</survey></document>"#
    );
    fs::write(dir.path().join("s.xml"), survey).unwrap();
    let mut args = vec!["s.xml", "-q", "-o", "a.xyz", "--pulses", "--waveforms"];
    args.extend(extra);
    succeed(dir.path(), &args);
    let table = |name: &str| {
        let content = text(&fs::read(dir.path().join(name)).unwrap());
        content.lines().map(|l| l.split(' ').map(|f| f.parse().unwrap()).collect()).collect()
    };
    [table("a.xyz"), table("a_pulse.txt"), table("a_fullwave.txt")]
}

fn column(rows: &[Vec<f64>], at: usize) -> Vec<f64> {
    rows.iter().map(|row| row[at]).collect()
}

/// The values about their mean, in standard deviations; the deviation must be the one asked for.
fn standardised(name: &str, values: &[f64], deviation: f64) -> Vec<f64> {
    let n = values.len() as f64;
    assert!(n > 1900.0, "{name}: {n} values");
    let mean = values.iter().sum::<f64>() / n;
    let moment = |p: i32| values.iter().map(|v| ((v - mean) / deviation).powi(p)).sum::<f64>() / n;
    // four standard errors of 2000 values
    assert!((moment(2) - 1.0).abs() < 0.13, "{name}: variance {} of what was asked for", moment(2));
    assert!(moment(3).abs() < 0.35, "{name}: third moment {}", moment(3));
    assert!((moment(4) - 3.0).abs() < 0.9, "{name}: fourth moment {}", moment(4));
    values.iter().map(|v| (v - mean) / deviation).collect()
}

fn sources(extra: &[&str]) -> Vec<(&'static str, Vec<f64>)> {
    let positions = r#"<positionXNoise mean="0" stdev="2"/><positionYNoise mean="0" stdev="2"/><positionZNoise mean="0" stdev="2"/>"#;
    let attitudes = r#"<attitudeXNoise mean="0" stdev="0.05"/><attitudeZNoise mean="0" stdev="0.05"/>"#;
    let [points, _, _] = run(extra, "1", "");
    let mut found = vec![("range", standardised("range", &column(&points, 1), 1.0))];
    let [_, pulses, _] = run(extra, "0", positions);
    for (name, at) in [("x", 0), ("y", 1), ("z", 2)] {
        found.push((name, standardised(name, &column(&pulses, at), 2.0)));
    }
    let [_, pulses, _] = run(extra, "0", attitudes);
    let angle = |at: usize| column(&pulses, at).iter().map(|c| c.asin()).collect::<Vec<_>>();
    found.push(("pitch", standardised("pitch", &angle(5), 0.05)));
    found.push(("yaw", standardised("yaw", &angle(3), 0.05)));
    let [_, _, clean] = run(extra, "0.5", "");
    let [_, _, noisy] = run(&[extra, &["--waveform-noise"]].concat(), "0.5", "");
    let sample: Vec<f64> = clean.iter().zip(&noisy).map(|(c, n)| n[12] - c[12]).collect();
    found.push(("waveform", standardised("waveform", &sample, 0.25)));
    found
}

#[test]
fn sources_are_normal_and_none_repeats_another() {
    let found = sources(&[]);
    for (i, (name, values)) in found.iter().enumerate() {
        for (other, others) in &found[i + 1..] {
            for sign in [1.0, -1.0] {
                let twins = values.windows(12).enumerate().find_map(|(at, window)| {
                    let is_twin = |w: &[f64]| w.iter().zip(window).all(|(a, b)| (sign * a - b).abs() < 0.05);
                    others.windows(12).position(is_twin).map(|there| (at, there))
                });
                assert_eq!(twins, None, "{name} and {other} share twelve values");
            }
        }
        // nor itself at another pulse
        let again = (1..values.len() - 12).find(|&shift| {
            values[shift..shift + 12].iter().zip(&values[..12]).all(|(a, b)| (a - b).abs() < 0.05)
        });
        assert_eq!(again, None, "{name} begins anew");
    }
}

#[test]
fn neither_threads_nor_chunks_matter() {
    assert!(sources(&["-j", "1"]) == sources(&["-j", "3", "--chunk-size", "17"]));
}
