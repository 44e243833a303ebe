//! Examples: scenes that the program makes itself, uploaded, planned and scanned by one click.

use super::form_body::{FormBody, genuine};
use super::layout::bad;
use crate::answers::Failure;
use crate::app::{App, Identity, blocking, submitting};
use crate::processes::Process;
use crate::store::{Job, Status};
use crate::submit::SubmitError;
use crate::uploads::{Received, UploadError};
use crate::worker::Workshop;
use axum::Extension;
use axum::extract::State;
use axum::response::{IntoResponse as _, Redirect, Response};
use serde_json::{Map, Value, json};
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time for which the form waits for the plan of an example before it leads to the page of the plan.
const MAX_WAIT: Duration = Duration::from_secs(20);
const POLL: Duration = Duration::from_millis(50);

/// An example.
#[derive(Debug)]
pub struct Example {
    /// Its name in the form.
    pub id: &'static str,
    /// Its name.
    pub title: &'static str,
    /// Description.
    pub about: &'static str,
    /// The name of its upload.
    upload: &'static str,
    /// The file of the upload that the scene is, or is made of.
    file: &'static str,
    /// The texts of the files of the upload.
    texts: fn() -> Vec<(&'static str, String)>,
}

/// All examples.
pub static EXAMPLES: [Example; 2] = [
    Example {
        id: "forest",
        title: "Scan a forest",
        about: "Trees of an inventory, scanned from a drone",
        upload: "example-forest",
        file: "trees.csv",
        texts: forest,
    },
    Example {
        id: "terrain",
        title: "Scan a terrain",
        about: "Hills with houses, scanned from a drone",
        upload: "example-terrain",
        file: "terrain.obj",
        texts: terrain,
    },
];

/// Uploads an example, plans a flight over it and runs the plan. Leads to the page of the run, or of the job
/// that is not finished or has failed.
pub async fn example(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Result<Response, Failure> {
    let id = genuine(&app, &identity, form)?.remove("example").unwrap_or_default();
    let example = EXAMPLES.iter().find(|example| example.id == id);
    let example = example.ok_or_else(|| bad("choose an example of the list"))?;
    let owner = identity.owner.clone();
    let upload = blocking(&app, move |workshop| uploaded(workshop, &owner, example)).await?;
    let file = format!("{upload}/{}", example.file);
    let mut scene = file.clone();
    if super::choices::is_table(&file) {
        let stand =
            finished(&app, &identity, Process::Stand, json!({ "inventory": file, "flat": true })).await?;
        if stand.status != Status::Successful {
            return Ok(page_of(&stand));
        }
        scene = format!("jobs/{}/stand/stand.xml", stand.id);
    }
    let plan = json!({
        "kind": "airborne",
        "scene": scene,
        "scanner": "data/scanners_als.xml#riegl_vux-1uav",
        "height": 60,
        "density": 10,
        "overlap": 30,
    });
    let plan = finished(&app, &identity, Process::Plan, plan).await?;
    if plan.status != Status::Successful {
        return Ok(page_of(&plan));
    }
    let run = json!({
        "pipeline": format!("jobs/{}/plan.toml", plan.id),
        "output": [{ "path": "points.copc.laz" }],
    });
    Ok(page_of(&submitted(&app, &identity, Process::Run, run).await?))
}

fn page_of(job: &Job) -> Response {
    Redirect::to(&format!("/jobs/{}", job.id)).into_response()
}

/// The name of the upload of an example: one that is there already is used again.
fn uploaded(workshop: &Workshop, owner: &str, example: &Example) -> Result<String, UploadError> {
    let store = &workshop.store;
    if let Some(known) = store.upload(owner, example.upload)? {
        let files = store.files(&known.id)?;
        if files.iter().any(|file| file.path == example.file) {
            return Ok(known.name);
        }
    }
    let received = Received::of_texts(store, owner, example.upload, &(example.texts)())?;
    Ok(received.list(owner, store, &workshop.limits)?.name)
}

async fn submitted(
    app: &Arc<App>,
    identity: &Identity,
    process: Process,
    inputs: Value,
) -> Result<Job, Failure> {
    let owner = identity.owner.clone();
    let inputs = if let Value::Object(inputs) = inputs { inputs } else { Map::new() };
    // A second click leads to the jobs of the first one.
    let submit = move |workshop: &Workshop| -> Result<Job, SubmitError> {
        match workshop.newest_like(&owner, process, &inputs)? {
            Some(job) => Ok(job),
            None => workshop.submit(&owner, process, &inputs),
        }
    };
    submitting(app, &identity.owner, submit).await
}

/// A job, finished unless it takes long.
async fn finished(
    app: &Arc<App>,
    identity: &Identity,
    process: Process,
    inputs: Value,
) -> Result<Job, Failure> {
    let mut job = submitted(app, identity, process, inputs).await?;
    let start = Instant::now();
    while !job.status.is_final() && start.elapsed() < MAX_WAIT {
        tokio::time::sleep(POLL).await;
        let (owner, id) = (identity.owner.clone(), job.id.clone());
        let found = blocking(app, move |workshop| workshop.store.job_state(&owner, &id)).await?;
        job = found.ok_or_else(|| Failure::no_job(&job.id))?;
    }
    Ok(job)
}

/// A number from 0 to 1 that looks random, the same for the same place.
fn scattered(row: u32, column: u32, of: u32) -> f64 {
    let mut mixed =
        row.wrapping_mul(0x9E37_79B1) ^ column.wrapping_mul(0x85EB_CA77) ^ of.wrapping_mul(0xC2B2_AE3D);
    mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
    mixed = (mixed ^ (mixed >> 12)).wrapping_mul(0x297A_2D39);
    f64::from(mixed ^ (mixed >> 15)) / f64::from(u32::MAX)
}

/// An inventory: rows of trees, each a little beside its place.
fn forest() -> Vec<(&'static str, String)> {
    let mut table = String::from("x,y,height,species\n");
    for row in 0..9 {
        for column in 0..9 {
            let at = |index: u32, of: u32| {
                f64::from(index) * 6.0 - 24.0 + 3.0 * (scattered(row, column, of) - 0.5)
            };
            let height = 14.0 + 10.0 * scattered(row, column, 3);
            let species = if scattered(row, column, 4) < 0.6 { "spruce" } else { "beech" };
            // Writing to a string does not fail.
            let _ = writeln!(table, "{:.2},{:.2},{height:.1},{species}", at(column, 1), at(row, 2));
        }
    }
    vec![("trees.csv", table)]
}

/// Vertices along a side of the terrain, and the distance between them, m.
const VERTICES: u32 = 46;
const STEP: f64 = 2.0;

fn height(x: f64, y: f64) -> f64 {
    4.0 * (x / 17.0).sin() * (y / 23.0).cos() + 2.0 * ((x + 2.0 * y) / 31.0).sin()
}

/// Hills and houses, with their materials.
fn terrain() -> Vec<(&'static str, String)> {
    let mut mesh = String::from("mtllib terrain.mtl\nusemtl ground\n");
    let place = |index: u32| (f64::from(index) - f64::from(VERTICES - 1) / 2.0) * STEP;
    for row in 0..VERTICES {
        for column in 0..VERTICES {
            let (x, y) = (place(column), place(row));
            let _ = writeln!(mesh, "v {x:.2} {y:.2} {:.2}", height(x, y));
        }
    }
    for row in 0..VERTICES - 1 {
        for column in 0..VERTICES - 1 {
            let first = row * VERTICES + column + 1;
            let above = first + VERTICES;
            let _ = writeln!(mesh, "f {first} {} {}\nf {first} {} {above}", first + 1, above + 1, above + 1);
        }
    }
    mesh += "usemtl house\n";
    let mut first = VERTICES * VERTICES + 1;
    for (x, y, width, depth) in [(-18.0, -12.0, 9.0, 7.0), (14.0, -4.0, 11.0, 8.0), (-4.0, 20.0, 8.0, 12.0)] {
        first = house(&mut mesh, first, [x, y], [width, depth]);
    }
    let materials = "newmtl ground\nKd 0.45 0.36 0.25\nhelios_classification 2\nhelios_isGround true\n\
                     newmtl house\nKd 0.7 0.3 0.25\nhelios_classification 6\n";
    vec![("terrain.obj", mesh), ("terrain.mtl", materials.to_owned())]
}

/// Adds a house with a gable roof, from 2 m below the ground; its first vertex has the number `first`.
/// Returns the number of the next one.
fn house(mesh: &mut String, first: u32, [x, y]: [f64; 2], [width, depth]: [f64; 2]) -> u32 {
    let ground = height(x, y);
    let (east, north) = (width / 2.0, depth / 2.0);
    let corners = [(-east, -north), (east, -north), (east, north), (-east, north)];
    for z in [ground - 2.0, ground + 5.0] {
        for (right, up) in corners {
            let _ = writeln!(mesh, "v {:.2} {:.2} {z:.2}", x + right, y + up);
        }
    }
    for right in [-east, east] {
        let _ = writeln!(mesh, "v {:.2} {y:.2} {:.2}", x + right, ground + 8.0);
    }
    let faces: [&[u32]; 6] =
        [&[0, 1, 5, 4], &[1, 2, 6, 9, 5], &[2, 3, 7, 6], &[3, 0, 4, 8, 7], &[4, 5, 9, 8], &[6, 7, 8, 9]];
    for face in faces {
        let numbers: Vec<String> = face.iter().map(|at| (first + at).to_string()).collect();
        let _ = writeln!(mesh, "f {}", numbers.join(" "));
    }
    first + 10
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_of_examples_name_vertices_that_they_have() {
        let texts = terrain();
        let mesh = &texts[0].1;
        let vertices = mesh.lines().filter(|line| line.starts_with("v ")).count();
        let faces = mesh.lines().filter_map(|line| line.strip_prefix("f "));
        let numbers: Vec<usize> =
            faces.flat_map(|face| face.split(' ')).map(|number| number.parse().unwrap()).collect();
        assert_eq!(numbers.iter().max(), Some(&vertices));
        assert_eq!(numbers.iter().min(), Some(&1));
        assert!(texts[1].1.contains("helios_isGround true"));
    }

    #[test]
    fn trees_of_the_example_stand_apart() {
        let table = &forest()[0].1;
        let trees: Vec<[f64; 2]> = table
            .lines()
            .skip(1)
            .map(|line| {
                let mut parts = line.split(',').map(|part| part.parse().unwrap_or_default());
                [parts.next().unwrap(), parts.next().unwrap()]
            })
            .collect();
        assert_eq!(trees.len(), 81);
        for (number, [x, y]) in trees.iter().enumerate() {
            for [other_x, other_y] in &trees[..number] {
                assert!((x - other_x).hypot(y - other_y) > 2.0, "{x} {y}");
            }
        }
    }
}
