//! Inputs whose values are changed: surveys of the conformance suite and of `fixtures/`, pipelines, tables.

use super::changes::Place;
use std::path::{Path, PathBuf};

/// A run and its files.
pub struct Subject {
    pub name: String,
    pub args: Vec<String>,
    /// Files by name, with what they contain.
    files: Vec<(String, Vec<u8>)>,
    /// The names of those that are changed.
    changed: Vec<String>,
}

impl Subject {
    /// Writes all files into a folder.
    pub fn copy_to(&self, folder: &Path) {
        for (name, content) in &self.files {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            std::fs::write(path, content).expect("a file");
        }
    }

    /// The files that are changed.
    pub fn changed_files(&self) -> impl Iterator<Item = (&str, &str)> {
        let is_changed = |name: &String| self.changed.contains(name);
        self.files
            .iter()
            .filter(move |(name, _)| is_changed(name))
            .map(|(name, content)| (name.as_str(), std::str::from_utf8(content).expect("text")))
    }

    /// The values of a file.
    pub fn places(&self, name: &str, content: &str) -> Vec<Place> {
        match Path::new(name).extension().and_then(|e| e.to_str()) {
            Some("xml") => xml(content),
            Some("toml") => toml(content),
            _ => table(name, content),
        }
    }

    fn with(mut self, name: &str, content: &str) -> Self {
        self.files.push((name.to_owned(), content.as_bytes().to_vec()));
        self.changed.push(name.to_owned());
        self
    }

    fn beside(mut self, name: &str, content: &str) -> Self {
        self.files.push((name.to_owned(), content.as_bytes().to_vec()));
        self
    }

    fn run(name: &str, args: &[&str]) -> Self {
        let args = args.iter().map(|arg| (*arg).to_owned()).collect();
        Self { name: name.to_owned(), args, files: Vec::new(), changed: Vec::new() }
    }
}

/// Attributes of a document; those of one element are told apart by its kind, as optics and filters have it.
fn xml(content: &str) -> Vec<Place> {
    let document = roxmltree::Document::parse(content).expect("XML");
    let mut all = Vec::new();
    for element in document.descendants().filter(roxmltree::Node::is_element) {
        let kind = ["optics", "type"].iter().find_map(|name| element.attribute(*name));
        // What a parameter is, its key says; its own `type` has no variants.
        let kind = element.attribute("key").or(kind).map_or(String::new(), |kind| format!("[{kind}]"));
        let parent = element.parent_element().map_or("", |parent| parent.tag_name().name());
        for attribute in element.attributes() {
            let (whole, value) = (attribute.range(), attribute.range_value());
            let name = whole.start..whole.start + attribute.name().len();
            let label = format!("{parent}/{}{kind}@{}", element.tag_name().name(), attribute.name());
            all.push(Place { label, value, name, whole, instead: "", quote: "" });
        }
    }
    all
}

/// Keys with a value on their line.
fn toml(content: &str) -> Vec<Place> {
    let (mut all, mut section, mut at) = (Vec::new(), String::new(), 0);
    for line in content.split_inclusive('\n') {
        let start = at;
        at += line.len();
        let trimmed = line.trim_end();
        if trimmed.starts_with('[') {
            section = trimmed.trim_matches(['[', ']']).to_owned();
        }
        let Some((key, value)) = trimmed.split_once(" = ") else { continue };
        if key.starts_with('#') {
            continue;
        }
        let value_start = start + key.len() + 3;
        let quoted = value.len() > 1 && value.starts_with(['"', '\'']);
        let (value, quote) = if quoted {
            (value_start + 1..value_start + value.len() - 1, "")
        } else {
            (value_start..value_start + value.len(), "\"")
        };
        let label = format!("{section}.{key}");
        all.push(Place {
            label,
            value,
            name: start..start + key.len(),
            whole: start..at,
            instead: "",
            quote,
        });
    }
    all
}

/// The headings of a table and the fields of its second line.
fn table(name: &str, content: &str) -> Vec<Place> {
    let separator = if content.contains(',') { ',' } else { ' ' };
    let mut all = Vec::new();
    let mut at = 0;
    for (number, line) in content.split_inclusive('\n').enumerate().take(3) {
        let mut start = at;
        at += line.len();
        for (column, field) in line.trim_end().split(separator).enumerate() {
            let range = start..start + field.len();
            start += field.len() + 1;
            if number != 1 && !field.is_empty() {
                let label = format!("{name}:{}{column}", if number == 0 { "heading " } else { "field " });
                let name = if number == 0 { range.clone() } else { 0..0 };
                all.push(Place { label, value: range.clone(), name, whole: range, instead: "", quote: "" });
            }
        }
    }
    all
}

/// A case of the conformance suite, with its options.
fn conformance(folder: &Path) -> Subject {
    let name = folder.file_name().expect("a name").to_string_lossy().into_owned();
    let mut subject = Subject::run(
        &name,
        &["run", "survey.xml", "--assets", ".", "--output", "out", "-j", "1", "--seed", "43"],
    );
    for path in crate::common::files(folder) {
        let inner = path.to_string_lossy().into_owned();
        if inner.starts_with("expected") || inner == "case.json" {
            continue;
        }
        let content = std::fs::read(folder.join(&path)).expect("a file of the case");
        if inner.ends_with(".xml") {
            subject.changed.push(inner.clone());
        }
        subject.files.push((inner, content));
    }
    subject
}

/// Cases of the conformance suite, where it lies beside the repository.
fn conformance_cases() -> Vec<Subject> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/conformance");
    let suite = std::env::var_os("VLSCAN_CONFORMANCE").map_or(beside, PathBuf::from);
    let Ok(entries) = std::fs::read_dir(&suite) else {
        crate::common::missing("conformance", &format!("no suite at {}", suite.display()));
        return Vec::new();
    };
    let mut folders: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path()).collect();
    folders.retain(|folder| folder.join("survey.xml").is_file());
    folders.sort();
    folders.iter().map(|folder| conformance(folder)).collect()
}

const PLANE: &str = "mtllib p.mtl\nv -40 -40 0\nv 40 -40 0\nv 40 40 0\nv -40 40 0\nusemtl a\nf 1 2 3 4\n";
const MATERIAL: &str = "newmtl a\nhelios_reflectance 0.4\nhelios_classification 2\nhelios_isGround true\n";

/// A drone with an instrument of two channels.
const DRONE: &str = include_str!("drone.toml");
/// A tripod with prisms.
const TRIPOD: &str = include_str!("tripod.toml");
/// A recorded flight.
const FLIGHT: &str = include_str!("flight.toml");

/// A flight of 30 m within half a second.
fn way() -> String {
    let mut text = "time,x,y,z,roll,pitch,yaw\n".to_owned();
    for i in 0..8 {
        let time = f64::from(i) / 10.0;
        text += &format!("{:.2},{:.2},1.5,40.25,0.5,-0.25,80.5\n", 5.0 + time, 20.0 * time - 5.0);
    }
    text
}

const OUT: [&str; 4] = ["-o", "out/o.csv", "-j", "1"];

fn pipelines() -> Vec<Subject> {
    let of = |name: &str, text: &str| {
        let args = [&["run", "p.toml"][..], &["-j", "1"][..]].concat();
        Subject::run(name, &args).with("p.toml", text).beside("a.obj", PLANE).beside("p.mtl", MATERIAL)
    };
    let flight = of("flight.toml", FLIGHT).with("way.csv", &way());
    vec![of("drone.toml", DRONE), of("tripod.toml", TRIPOD), flight]
}

fn tables() -> Vec<Subject> {
    let scanner = "data/scanners_als.xml#riegl_vux-1uav";
    let trace = [&["trace", "rays.csv", "--scene", "a.obj", "--scanner", scanner][..], &OUT].concat();
    let rays = "time,x,y,z,dx,dy,dz\n1.5,2.25,3.5,40.25,0.125,0.25,-1\n2.5,3.25,4.5,41.25,0.1,0.2,-1\n3.5,3.25,4.5,41.25,0.1,0.2,-1\n";
    let pulses =
        Subject::run("trace", &trace).with("rays.csv", rays).beside("a.obj", PLANE).beside("p.mtl", MATERIAL);
    let trace = [&["trace", "rays.csv", "--scene", "t.csv", "--scanner", scanner][..], &OUT].concat();
    let instances = Subject::run("instances", &trace)
        .beside("rays.csv", rays)
        .with("t.csv", "file,x,y,z,yaw,scale\na.obj,1.5,2.5,3.5,30.5,1.25\na.obj,2.5,2.5,3.5,20.5,1.5\n")
        .beside("a.obj", PLANE)
        .beside("p.mtl", MATERIAL);
    vec![pulses, instances]
}

/// All subjects, the small ones that cover most first.
pub fn all() -> Vec<Subject> {
    let mut all = pipelines();
    all.extend(tables());
    all.extend(conformance_cases());
    all
}
