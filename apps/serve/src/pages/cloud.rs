//! The points of a result, to turn around: the page names the file, of which a script reads what the picture
//! needs.

use super::layout::form_token;
use crate::answers::encoded;
use crate::app::{App, Identity};
use crate::store::{Job, ResultFile};
use maud::{Markup, html};

/// Ending of the files that are read in ranges.
const OCTREE: &str = ".copc.laz";
/// Endings of other files of points that a copy can be made of.
const CLOUDS: [&str; 11] =
    [".laz", ".las", ".ply", ".xyz", ".pcd", ".e57", ".pts", ".ptx", ".csv", ".arrow", ".parquet"];

/// True if points of the file can be shown, if need be by a copy.
pub fn is_cloud(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    CLOUDS.iter().any(|ending| name.ends_with(ending))
}

/// True if a file is read in ranges.
pub fn is_octree(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(OCTREE)
}

/// The points of a result: those of the COPC `wanted` or of the first one, else a form that has a copy made
/// of another file.
pub fn cloud(
    app: &App,
    identity: &Identity,
    job: &Job,
    files: &[ResultFile],
    wanted: Option<&str>,
    picture: &Markup,
) -> Markup {
    let mut octrees = files.iter().filter(|file| is_octree(&file.path));
    let first = octrees.clone().next();
    if let Some(file) = octrees.find(|file| Some(file.path.as_str()) == wanted).or(first) {
        return html! {
            @if files.iter().filter(|file| is_octree(&file.path)).count() > 1 { p { strong { (file.path) } } }
            (viewer(&format!("/jobs/{}/results/{}", job.id, encoded(&file.path)), picture))
        };
    }
    let Some(file) = files.iter().find(|file| is_cloud(&file.path)) else { return picture.clone() };
    html! {
        (picture)
        (show_form(app, identity, &format!("jobs/{}/{}", job.id, file.path), "Show the points to turn around"))
    }
}

/// A form that has a copy made for the viewer.
pub fn show_form(app: &App, identity: &Identity, name: &str, label: &str) -> Markup {
    html! {
        form .inline method="post" action="/forms/view" {
            (form_token(app, identity))
            input type="hidden" name="points" value=(name);
            button .quiet type="submit" { (label) }
        }
    }
}

/// The viewer of the COPC at an address, with what takes its place where it cannot show it.
pub fn viewer(address: &str, picture: &Markup) -> Markup {
    html! {
        script type="module" src="/static/viewer/viewer.js" {}
        section #cloud .cloud data-cloud=(address) aria-label="The points, to turn around" {
            (controls())
            div .stage {
                canvas tabindex="0" role="img" aria-label="The points" aria-describedby="hands" {}
                p .ruler hidden { span {} }
            }
            p .facts { span .count {} " " span .slab {} }
            p .said role="status" {}
            // Where there is no WebGL.
            div .instead hidden { (picture) }
            div .bar hidden role="img" { div .ramp {} div .ticks {} }
            ul .legend aria-label="Colours" {}
            p #hands { small {
                "Drag to turn, Shift or the right button to move. The wheel enlarges after a click on the points, or with Ctrl. One finger to the side "
                "turns, up and down scrolls the page; two fingers move and enlarge; on the full screen one finger turns in all directions. Keys: arrows "
                "turn, Shift and arrows move, + and − enlarge, Home shows all."
            } }
            noscript { p { "Turning the points needs JavaScript." } (picture) }
        }
    }
}

/// The controls of the viewer, above the points.
fn controls() -> Markup {
    html! {
        form .controls hidden autocomplete="off" {
            div .row {
                label {
                    "Colour"
                    select name="colouring" {
                        option value="height" { "Height" }
                        option value="intensity" { "Intensity" }
                        option value="return" { "Return" }
                        option value="class" { "Class" }
                        option value="object" { "Object" }
                    }
                }
                label {
                    "Section"
                    select name="section" {
                        option value="" { "none" }
                        option value="x" { "across x" }
                        option value="y" { "across y" }
                        option value="z" { "across z" }
                    }
                }
                label .of-section hidden { "Place of the section" input type="range" name="at" min="0" max="1" step="0.002" value="0.5" disabled; }
                label .of-section hidden { "Thickness" input type="range" name="thickness" min="0" max="1" step="0.01" value="0.25" disabled; }
            }
            div .views {
                @for (view, name) in [("home", "Whole cloud"), ("above", "From above"), ("south", "From the south"), ("east", "From the east")] {
                    button .quiet type="button" data-view=(view) { (name) }
                }
                button .quiet type="button" data-full { "Full screen" }
            }
            details .more {
                summary { "Points" }
                div .row {
                    label { "Size of points" input type="range" name="size" min="1" max="8" step="0.5" value="2"; }
                    label {
                        "Most points"
                        select name="budget" {
                            option value="300000" { "0.3 million" }
                            option value="1000000" selected { "1 million" }
                            option value="3000000" { "3 million" }
                            option value="8000000" { "8 million" }
                        }
                    }
                }
            }
        }
    }
}
