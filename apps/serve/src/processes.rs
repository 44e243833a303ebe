//! Processes on offer, and their descriptions for programs: by the options of the command or the keys of the
//! file.

use crate::program::Program;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// A process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Process {
    /// A pipeline's points.
    Run,
    /// A survey from an area, a plot or a line.
    Plan,
    /// The forecast of a run.
    DryRun,
    /// A data set.
    Campaign,
    /// Two clouds.
    Compare,
    /// A scene of the trees of an inventory.
    Stand,
    /// A picture or page of a cloud or survey, or a copy of a cloud for viewers.
    Preview,
}

/// An output of a process.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Its name.
    pub name: &'static str,
    /// Description.
    pub about: &'static str,
    /// Its media type, and whether it is given as a value in results.
    pub media: &'static str,
}

/// Way in which an output is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transmission {
    /// As it is, in the answer.
    Value,
    /// As a link.
    Reference,
}

impl Process {
    /// All of them.
    pub const ALL: [Process; 7] = [
        Process::Run,
        Process::Plan,
        Process::DryRun,
        Process::Campaign,
        Process::Compare,
        Process::Stand,
        Process::Preview,
    ];

    /// Its id.
    pub fn id(self) -> &'static str {
        match self {
            Process::Run => "run",
            Process::Plan => "plan",
            Process::DryRun => "dry-run",
            Process::Campaign => "campaign",
            Process::Compare => "compare",
            Process::Stand => "stand",
            Process::Preview => "preview",
        }
    }

    /// The process of that id.
    pub fn named(id: &str) -> Option<Process> {
        Process::ALL.into_iter().find(|process| process.id() == id)
    }

    /// A title.
    pub fn title(self) -> &'static str {
        match self {
            Process::Run => "Scan a scene",
            Process::Plan => "Plan a survey",
            Process::DryRun => "Forecast a run",
            Process::Campaign => "Make a data set",
            Process::Compare => "Compare two clouds",
            Process::Stand => "Make a stand of an inventory",
            Process::Preview => "Draw a cloud or a survey",
        }
    }

    fn about(self) -> &'static str {
        match self {
            Process::Run => {
                "Flies an instrument over a scene and writes the point cloud that it would have measured. Inputs are the keys of a pipeline \
                 file; `pipeline` names a file whose keys they change. Without outputs, points go to points.laz."
            }
            Process::Plan => {
                "Plans flight lines over an area, tripod positions or a drive (`kind`). Inputs are the options of `vlscan plan`. The result is \
                 a pipeline file for the process run."
            }
            Process::DryRun => {
                "Forecasts a run without writing points: duration, pulses, points, density, sizes, memory and time. Inputs are those of run."
            }
            Process::Campaign => {
                "One run for every scene, variant and seed. Inputs are the keys of a campaign's file, except `out`."
            }
            Process::Compare => {
                "Compares two point clouds of one place: density, heights, intensities, returns, distances. Inputs are the options of \
                 `vlscan compare`."
            }
            Process::Stand => {
                "A scene of the trees of an inventory (x, y, height …), perhaps on terrain. Inputs are the options of `vlscan scene stand`."
            }
            Process::Preview => {
                "A picture (`format` png) or an interactive page (html) of a cloud or survey, or all points of a cloud as COPC, which viewers \
                 read in ranges (copc.laz)."
            }
        }
    }

    /// True if a request is answered with results unless it prefers a job.
    pub fn is_quick(self) -> bool {
        !matches!(self, Process::Run | Process::Campaign)
    }

    /// Way in which outputs are given unless a request names another one. Processes with many files only link
    /// them.
    pub fn transmission(self) -> Transmission {
        match self {
            Process::Campaign | Process::Stand => Transmission::Reference,
            Process::Run | Process::Plan | Process::DryRun | Process::Compare | Process::Preview => {
                Transmission::Value
            }
        }
    }

    /// Outputs. Runs and campaigns have files of other names, too.
    pub fn outputs(self) -> &'static [Output] {
        match self {
            Process::Run => &[Output {
                name: "points.laz",
                about: "The point cloud, or the files of `output`.",
                media: "application/vnd.laszip",
            }],
            Process::Plan => {
                &[Output { name: "plan.toml", about: "A pipeline file.", media: "application/toml" }]
            }
            Process::DryRun => {
                &[Output { name: "report.json", about: "The forecast.", media: "application/json" }]
            }
            Process::Campaign => &[Output {
                name: "dataset/manifest.jsonl",
                about: "A line per cell; the files of cells are listed beside it.",
                media: "application/jsonl",
            }],
            Process::Compare => &[
                Output { name: "report.json", about: "The figures.", media: "application/json" },
                Output {
                    name: "report.html",
                    about: "A page with tables, charts and pictures.",
                    media: "text/html",
                },
            ],
            Process::Stand => &[Output {
                name: "stand/stand.xml",
                about: "The scene; the files that it needs are beside it.",
                media: "application/xml",
            }],
            Process::Preview => &[
                Output { name: "preview.png", about: "The picture, for the format png.", media: "image/png" },
                Output { name: "preview.html", about: "The page, for the format html.", media: "text/html" },
                Output {
                    name: "preview.copc.laz",
                    about: "The points, for the format copc.laz.",
                    media: "application/vnd.laszip",
                },
            ],
        }
    }

    /// JSON Schema of its inputs; `x-option` and `x-operand` say what becomes of those that are options.
    pub fn inputs(self, program: &Program) -> Value {
        match self {
            Process::Run | Process::DryRun => pipeline_inputs(program),
            Process::Plan => plan_inputs(program),
            Process::Campaign => campaign_inputs(),
            Process::Compare => {
                // The service limits the memory of jobs.
                let own = ["json", "page", "change", "changed", "force", "max_memory"];
                without(&program.commands["compare"], &own)
            }
            Process::Stand => without(&program.commands["scene stand"], &["out", "copy", "force"]),
            Process::Preview => {
                let own = ["out", "assets", "force", "max_points", "max_memory"];
                let mut schema = without(&program.commands["preview"], &own);
                schema["properties"]["format"] = json!({
                    "type": "string", "enum": ["png", "html", "copc.laz"],
                    "description": "Picture, page, or all points as COPC for viewers. [default: png]"
                });
                schema
            }
        }
    }

    /// The entry of the list of processes.
    pub fn summary(self, program: &Program) -> Value {
        let control = if self.is_quick() {
            json!(["sync-execute", "async-execute", "dismiss"])
        } else {
            json!(["async-execute", "dismiss"])
        };
        let transmissions: &[Transmission] = match self.transmission() {
            Transmission::Value => &[Transmission::Value, Transmission::Reference],
            Transmission::Reference => &[Transmission::Reference],
        };
        json!({
            "id": self.id(),
            "version": program.version,
            "title": self.title(),
            "description": self.about(),
            "jobControlOptions": control,
            "outputTransmission": transmissions,
            "links": [{
                "href": format!("/processes/{}", self.id()), "rel": "self", "type": "application/json", "title": "Description"
            }],
        })
    }

    /// The description of the process.
    pub fn description(self, program: &Program) -> Value {
        let schema = self.inputs(program);
        let required: Vec<&str> =
            schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let mut inputs = Map::new();
        for (key, schema) in schema["properties"].as_object().into_iter().flatten() {
            let about = schema["description"].as_str().unwrap_or_default();
            let title = about.split(['.', ';', '\n']).next().unwrap_or_default();
            let occurs = u32::from(required.contains(&key.as_str()));
            let schema = published(schema);
            inputs.insert(
                key.clone(),
                json!({ "title": title, "description": about, "minOccurs": occurs, "maxOccurs": 1, "schema": schema }),
            );
        }
        let mut outputs = Map::new();
        for output in self.outputs() {
            let schema = match output.media {
                "application/json" => json!({ "type": "object", "contentMediaType": output.media }),
                media => json!({ "type": "string", "format": "binary", "contentMediaType": media }),
            };
            outputs.insert(output.name.to_owned(), json!({ "title": output.about, "schema": schema }));
        }
        let mut description = self.summary(program);
        description["inputs"] = Value::Object(inputs);
        description["outputs"] = Value::Object(outputs);
        description["links"] = json!([
            { "href": format!("/processes/{}", self.id()), "rel": "self", "type": "application/json", "title": "This description" },
            {
                "href": format!("/processes/{}/execution", self.id()), "rel": "http://www.opengis.net/def/rel/ogc/1.0/execute",
                "type": "application/json", "title": "Execute"
            },
        ]);
        description
    }
}

/// The keys of a pipeline file but for those that concern the machine, and the file to begin with.
fn pipeline_inputs(program: &Program) -> Value {
    let mut schema = without(&program.pipeline, &["assets", "force", "schedule"]);
    schema["properties"]["pipeline"] = json!({
        "type": "string",
        "description": "A pipeline file (.toml) among uploads or results, whose keys the other inputs replace."
    });
    schema
}

/// The options of all kinds of plans.
fn plan_inputs(program: &Program) -> Value {
    let kinds = ["airborne", "terrestrial", "mobile"];
    let mut properties = Map::new();
    for kind in kinds {
        let options = without(&program.commands[format!("plan {kind}")], &["out", "assets", "force"]);
        for (key, schema) in options["properties"].as_object().into_iter().flatten() {
            properties.entry(key).or_insert_with(|| schema.clone());
        }
    }
    properties.insert(
        "kind".to_owned(),
        json!({ "type": "string", "enum": kinds, "description": "What kind of survey." }),
    );
    json!({ "type": "object", "properties": properties, "required": ["kind", "scanner"], "additionalProperties": false })
}

/// The keys of a campaign's file.
fn campaign_inputs() -> Value {
    let text = |about: &str| json!({ "type": "string", "description": about });
    json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["scene", "variant"],
        "properties": {
            "seeds": {
                "anyOf": [{ "type": "integer" }, { "type": "array", "items": { "type": "integer" } }],
                "description": "Seeds: a list, or how many, from 1."
            },
            "format": text("Format of the points. [default: laz]"),
            "run": text("Options of `vlscan run` for all variants."),
            "split": { "type": "object", "description": "Training, validation and test: by, train, validation, test, seed." },
            "scene": { "type": "array", "items": { "type": "object" }, "description": "Scenes: name, and one of file, make, stand; area, plots, plot_m, margin_m." },
            "variant": { "type": "array", "items": { "type": "object" }, "description": "Variants: name, and one of plan, survey; run." },
        }
    })
}

/// A schema without some of its properties.
fn without(schema: &Value, keys: &[&str]) -> Value {
    let mut schema = schema.clone();
    if let Some(properties) = schema["properties"].as_object_mut() {
        properties.retain(|key, _| !keys.contains(&key.as_str()));
    }
    if let Some(required) = schema.get_mut("required").and_then(Value::as_array_mut) {
        required.retain(|key| !keys.iter().any(|gone| key == gone));
    }
    schema
}

/// A schema as it is published: without the keys of our own.
fn published(schema: &Value) -> Value {
    match schema {
        Value::Object(map) => map
            .iter()
            .filter(|(key, _)| !key.starts_with("x-"))
            .map(|(key, value)| (key.clone(), published(value)))
            .collect(),
        Value::Array(list) => list.iter().map(published).collect(),
        other => other.clone(),
    }
}
