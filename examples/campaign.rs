//! A data set from a matrix: one plot, scanned by a drone at two heights with two seeds.
//! `cargo run --example campaign`.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use vlscan::tools::generate::{SceneKind, SceneOptions, write_scene};
use vlscan::{Campaign, CampaignEvent, CampaignOptions, Stop};

/// Ends the campaign in order; a program sets it when it is interrupted.
static STOP: Stop = Stop::new();

const CAMPAIGN: &str = r#"
out = "set"
seeds = 2
run = "--labels"
split = { by = "seed", train = 1, test = 1 }

[[scene]]
name = "hills"
file = "hills/scene.xml#terrain"
area = "POLYGON ((-20 -20, 20 -20, 20 20, -20 20))"

[[variant]]
name = "low"
plan = "airborne --scanner riegl_vux-1uav --height 40 --density 5"

[[variant]]
name = "high"
plan = "airborne --scanner riegl_vux-1uav --height 80 --density 5"
"#;

fn main() -> vlscan::Result<()> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let hills = SceneOptions { extent: Some(150.0), ..SceneOptions::new(SceneKind::Terrain, 2000) };
    write_scene(&hills, &folder.path().join("hills"))?;

    let campaign = Campaign::parse(&folder.path().join("campaign.toml"), CAMPAIGN.to_owned())?;
    let names: Vec<&str> = campaign.cells().iter().map(|cell| cell.name.as_str()).collect();
    assert_eq!(names, ["hills-low-1", "hills-high-1", "hills-low-2", "hills-high-2"]);

    // One cell first; another process could compute the others meanwhile.
    let one = CampaignOptions { cells: vec!["hills-low-1".to_owned()], ..CampaignOptions::default() };
    let report = campaign.run(&one, &STOP, show)?;
    assert_eq!((report.computed, report.left), (1, 3));

    let warnings = Arc::new(AtomicUsize::new(0));
    let counted = warnings.clone();
    let report = campaign.run(&CampaignOptions::default(), &STOP, move |event| {
        counted.fetch_add(usize::from(matches!(event, CampaignEvent::Warning { .. })), Ordering::Relaxed);
        show(event);
    })?;
    assert!(report.failed.is_empty(), "{:?}", report.failed);
    assert_eq!((report.computed, report.left, report.cells), (3, 0, 4));
    // 5 points per m² of 1600 m², four times.
    assert!((report.points as f64 / (4.0 * 1600.0 * 5.0) - 1.0).abs() < 0.2, "{} points", report.points);
    let manifest = report.manifest.expect("no cell is left");
    println!(
        "{} points, {} warnings, {}",
        report.points,
        warnings.load(Ordering::Relaxed),
        manifest.display()
    );
    let lines = std::fs::read_to_string(&manifest).expect("the manifest");
    assert_eq!(lines.lines().filter(|line| line.contains("\"split\":\"train\"")).count(), 2);

    // What is complete stays.
    assert_eq!(campaign.run(&CampaignOptions::default(), &STOP, show)?.computed, 0);
    Ok(())
}

fn show(event: CampaignEvent) {
    match event {
        CampaignEvent::Completed { cell, points, seconds } => {
            println!("{cell}: {points} points in {seconds:.1} s")
        }
        CampaignEvent::Warning { cell, text } => println!("{cell}: {text}"),
        CampaignEvent::Failed { cell, error } => println!("{cell} failed: {error}"),
        _ => {}
    }
}
