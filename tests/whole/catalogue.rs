//! Every scanner of the built-in catalogue gives points, and `vlscan catalogue` lists all of them.

use crate::common;
use crate::common::{fixture, folder, run, succeed, text};
use std::fs;
use vlscan::survey::{Scanner, catalogue};

/// A survey of 3000 pulses per device over a fixture, from where the scanner can see it.
fn survey(reference: &str, scanner: &Scanner) -> String {
    let device = &scanner.devices[0];
    let airborne = reference.contains("_als");
    let frequency = scanner.pulse_freqs.iter().min().copied().unwrap_or(10_000);
    let (slowest, fastest) = device.scan_freq;
    let scans = if fastest > 0.0 { 10f64.clamp(slowest.min(fastest), fastest) } else { 10f64.max(slowest) };
    let (scene, platform, z) = if airborne {
        let z = (1.3 * device.detector.range_min).max(60.0);
        // The mounts of the UAV scanners already point their profile downwards.
        let platform = if reference.contains("vux-") { "copter_linearpath" } else { "sr22" };
        (fixture("terrain/scene.xml"), platform, z)
    } else {
        (fixture("room/scene.xml"), "tripod", 0.0)
    };
    let name = if airborne { "terrain" } else { "room" };
    // Scanners with a view all around may be mounted in any direction.
    let most = device.scan_angle_max.to_degrees();
    let angle = if airborne && most < 60.0 { most.min(20.0) } else { most };
    let head = device.head.max_rate.to_degrees().min(3600.0);
    let arrival = if airborne {
        format!(
            r#"<leg><platformSettings x="0.3" y="100" z="{z}"/><scannerSettings active="false" scanFreq_hz="{scans}"/></leg>"#
        )
    } else {
        String::new()
    };
    format!(
        r#"<?xml version="1.0"?><document>
<survey name="s" scene="{}#{name}" platform="data/platforms.xml#{platform}" scanner="{reference}">
  <leg><platformSettings x="0.3" y="-0.2" z="{z}" movePerSec_m="{}"/>
  <scannerSettings active="true" pulseFreq_hz="{frequency}" scanAngle_deg="{angle}" scanFreq_hz="{scans}"
    headRotatePerSec_deg="{head}" headRotateStart_deg="0" headRotateStop_deg="{}" maxDuration_s="{}"/></leg>
  {arrival}
</survey></document>"#,
        scene.display(),
        if airborne { 30 } else { 0 },
        if head > 0.0 { 360 } else { 0 },
        3000.0 / f64::from(frequency)
    )
}

#[test]
fn every_scanner_sees_something() {
    let (known, _) = catalogue().unwrap();
    let dir = folder();
    let mut blind = Vec::new();
    for (reference, scanner) in &known.scanners {
        fs::write(dir.path().join("s.xml"), survey(reference, scanner)).unwrap();
        // The reference's beam is focused at the nearest range, and nothing comes back from a focus at 0.
        let physics = if scanner.devices[0].detector.range_min > 0.0 { "helios" } else { "refined" };
        let out =
            common::run(dir.path(), &["s.xml", "-o", "-", "--format", "xyz", "-q", "--physics", physics]);
        let points = text(&out.stdout).lines().count();
        if !out.status.success() || points < 100 {
            blind.push(format!("{reference}: {points} points {}", text(&out.stderr)));
        }
    }
    assert!(blind.is_empty(), "{}", blind.join("\n"));
}

#[test]
fn the_catalogue_is_listed_and_filtered() {
    let dir = folder();
    let (known, _) = catalogue().unwrap();
    let all = text(&succeed(dir.path(), &["catalogue"]).stdout);
    let references = known.scanners.iter().map(|s| &s.0).chain(known.platforms.iter().map(|p| &p.0));
    for reference in references {
        assert!(all.lines().any(|l| l.starts_with(&format!("{reference} "))), "{reference}\n{all}");
    }
    let some = text(&succeed(dir.path(), &["catalogue", "VZ"]).stdout);
    assert!(some.contains("#riegl_vz400") && !some.contains("#vlp16"), "{some}");
    // `list` is no filter, and several words are.
    let listed = |args: &[&str]| text(&succeed(dir.path(), &[&["catalogue"][..], args].concat()).stdout);
    assert_eq!(listed(&["list"]), all);
    assert_eq!(listed(&["list", "VZ"]), some);
    assert_eq!(listed(&["list", "--json", "livox"]), listed(&["livox", "--json"]));
    let both = listed(&["riegl", "1uav"]);
    assert!(both.contains("#riegl_vux-1uav") && !both.contains("#riegl_vz400"), "{both}");
    for (args, help) in [
        (&["livox", "vlp6"][..], "has `livox` and `vlp6` in its name; did you mean `vlp16`?"),
        (&["livox", "vlp16"], "`vlscan catalogue` lists all entries"),
        (&["shw", "vlp16"], "`vlscan catalogue show vlp16` shows a scanner"),
        (&["--json", "show", "vlp16"], "`vlscan catalogue show vlp16` shows a scanner; options follow it"),
    ] {
        let none = run(dir.path(), &[&["catalogue"][..], args].concat());
        let said = text(&none.stderr);
        assert!(none.status.code() == Some(2) && said.contains(help), "{args:?}: {said}");
    }
    let none = run(dir.path(), &["catalogue", "no such thing"]);
    assert!(none.status.code() == Some(2) && none.stdout.is_empty() && !none.stderr.is_empty());
}

#[test]
fn the_catalogue_as_json() {
    let dir = folder();
    let json = succeed(dir.path(), &["catalogue", "--json", "vlp16"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let row = &json["scanners"][0];
    assert_eq!(
        (row["reference"].as_str(), row["channels"].as_u64()),
        (Some("data/scanners_tls.xml#vlp16"), Some(16))
    );
    assert!(row["divergence_mrad"].as_f64().unwrap() > 0.0 && row["pulse_rates_hz"].is_array());
}

#[test]
fn a_scanner_is_shown_and_drawn() {
    let dir = folder();
    let show = ["catalogue", "show", "ouster_os1-128"];
    let figures = text(&succeed(dir.path(), &[&show[..], &["--picture", "a.svg"]].concat()).stdout);
    for line in
        ["channels         128", "pulse rates      20.48, 10.24 kHz", "360° all around, 43° up and down"]
    {
        assert!(figures.contains(line), "{figures}");
    }
    let drawing = fs::read_to_string(dir.path().join("a.svg")).unwrap();
    assert!(
        drawing.starts_with("<svg ") && drawing.ends_with("</svg>\n") && drawing.contains("Ouster OS1-128")
    );
    // Each channel is a line at its own height.
    assert_eq!(drawing.matches("h0\"/>").count(), 128);
    let again = common::run(dir.path(), &[&show[..], &["--picture", "a.svg"]].concat());
    assert_eq!(again.status.code(), Some(2));
    assert!(text(&again.stderr).contains("--force"), "{}", text(&again.stderr));
    let unknown = common::run(dir.path(), &["catalogue", "show", "nonesuch"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown.stderr).contains("nonesuch"), "{}", text(&unknown.stderr));
}
