//! Scenes and their parts (spec input-formats §3).

use super::context::Context;
use super::fields::Fields;
use super::instances::{Base, Row, read_table};
use super::keys::Key;
use super::loaders::{LOADERS, read_loader};
use super::motions::{check_timing, positive_time, read_motions, read_step, read_timing};
use super::xml::Element;
use super::{Loader, MeshReading, PartRecipe, SceneRecipe, Swap, Transform};
use std::collections::HashSet;
use vlscan_base::diag::{Place, nearest};
use vlscan_base::quantity::{COUNT_ABOVE_0, number};
use vlscan_geom::DVec3;

pub(super) fn read_scene_element(context: &Context, element: &Element) -> Option<SceneRecipe> {
    let mut fields = Fields::new(context, element);
    let id = fields.text("id").unwrap_or_default();
    let dyn_step = read_step(&mut fields, "dynStep");
    let dyn_time_step = positive_time(&mut fields, "dynTimeStep");
    fields.ignore(&["name"]);
    fields.done(&["part"]);
    if dyn_time_step.is_some_and(|t| t > 1.0) {
        context.warn(element.value_place("dynTimeStep"), "the scene moves less than once per second");
    }
    warn_of_repeated_ids(context, "part", element.named("part"));
    let mut parts = Vec::new();
    let mut number = 0;
    if dyn_time_step.is_some() && element.value("dynStep").is_some() {
        context.warn(element.name_place("dynStep"), "`dynStep` has no effect beside `dynTimeStep`");
    }
    for part in element.named("part") {
        check_timing(context, &part, element, dyn_time_step);
        let read = read_part(context, &part, number);
        // a skipped part still consumes its number
        number += u32::try_from(read.len().max(1)).unwrap_or(u32::MAX);
        parts.extend(read);
    }
    if parts.is_empty() && (element.child("part").is_none() || !context.failed()) {
        context.error(element.place(), "the scene has no parts");
    }
    let asset_folders = context.assets.folders(element.folder());
    Some(SceneRecipe {
        id,
        path: element.path().to_path_buf(),
        parts,
        dyn_step,
        dyn_time_step,
        packed: None,
        asset_folders,
    })
}

/// Warns of elements with the id of an earlier one, which outputs cannot distinguish.
pub(super) fn warn_of_repeated_ids(context: &Context, what: &str, elements: impl Iterator<Item = Element>) {
    let mut ids = HashSet::new();
    for element in elements {
        let Some(id) = element.value("id").filter(|id| !id.is_empty()) else { continue };
        if !ids.insert(id.to_owned()) {
            let message = format!("a second <{what}> has the id `{id}`: outputs cannot tell them apart");
            context.warn(element.value_place("id"), message);
        }
    }
}

/// Reads a `<part>`: usually one recipe, none for a part without geometry, and one per file for a part
/// without an id that is loaded from several files.
fn read_part(context: &Context, element: &Element, number: u32) -> Vec<PartRecipe> {
    let mut fields = Fields::new(context, element);
    let id = fields.text("id").filter(|id| !id.is_empty());
    let timing = read_timing(&mut fields);
    fields.ignore(&["name"]);
    fields.done(&["filter", "swap", "dmotion"]);
    if element.child("filter").is_none() {
        context.error(element.place(), "a <part> needs a <filter> that loads its geometry");
        return Vec::new();
    }
    let mut chain = Chain::default();
    let has_swaps = element.child("swap").is_some();
    for filter in element.named("filter") {
        chain.add(context, &filter, if has_swaps { Where::SwappedPart } else { Where::Part });
    }
    let motions = read_motions(context, element);
    let mut swaps = read_swaps(context, element, chain.transform.on_ground);
    if !swaps.is_empty() && !motions.is_empty() {
        let message = "a moving part cannot be swapped; its <swap> elements are ignored";
        context.warn(element.child("swap").as_ref().unwrap_or(element).place(), message);
        swaps.clear();
    }
    let placed: Vec<(Loader, Transform, Place)> = match (chain.rows, chain.loader) {
        (Some(rows), _) => {
            let place = |row: Row| (row.loader, chain.transform.after(&row.transform), row.place);
            rows.into_iter().map(place).collect()
        }
        (None, Some(loader)) => {
            let loaders = if id.is_none() { loader.per_file() } else { vec![loader] };
            loaders.into_iter().map(|loader| (loader, chain.transform, element.place())).collect()
        }
        (None, None) => {
            if !chain.loader_failed {
                context.warn(element.place(), "a part without a loader is skipped");
            }
            Vec::new()
        }
    };
    let recipe = |((loader, transform, place), number)| PartRecipe {
        id: id.clone(),
        motions: motions.clone(),
        timing,
        swaps: swaps.clone(),
        place: Some(place),
        number,
        transform,
        ..PartRecipe::new(loader)
    };
    placed.into_iter().zip(number..).map(recipe).collect()
}

/// The context in which a chain of filters occurs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Where {
    Part,
    /// A part with swaps, which may have only one loader.
    SwappedPart,
    Swap,
}

/// The accumulated effect of a chain of filters (spec input-formats §3.3).
#[derive(Default)]
struct Chain {
    loader: Option<Loader>,
    /// True if a loader occurred that could not be read.
    loader_failed: bool,
    /// The instances of a table; `None` without a table.
    rows: Option<Vec<Row>>,
    filters: usize,
    transform: Transform,
    scale: Option<f64>,
    offset: Option<DVec3>,
    on_ground: Option<i64>,
}

impl Chain {
    fn add(&mut self, context: &Context, filter: &Element, place: Where) {
        let Some(kind) = filter.value("type").map(str::to_ascii_lowercase) else {
            return context.error(filter.place(), "<filter> needs the attribute `type`");
        };
        let params = || Fields::of_params(context, filter);
        match kind.as_str() {
            "rotate" => self.rotate(params(), place),
            "scale" => self.scale(params()),
            "translate" => self.translate(params()),
            "instances" => self.place_instances(params(), place),
            loader if LOADERS.contains(&loader) => self.load(params(), loader, place),
            other => {
                let known = LOADERS.iter().copied().chain(["instances", "rotate", "scale", "translate"]);
                let help = match nearest(other, known.clone()) {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => format!("the filters are {}", known.collect::<Vec<_>>().join(", ")),
                };
                let message = format!("unknown filter type `{}`", filter.value("type").unwrap_or_default());
                context.error_help(filter.value_place("type"), message, help);
                self.loader_failed = self.loader.is_none();
            }
        }
        self.filters += 1;
    }

    /// Applies a loader, which discards the effect of the filters before it.
    fn load(&mut self, params: Fields, kind: &str, place: Where) {
        let (context, at) = (params.context, params.own_place());
        let second = self.loader.is_some() || self.loader_failed;
        match place {
            Where::Swap if self.filters > 0 => {
                context.error(at, "a loader must be the first filter of a <swap>");
            }
            Where::SwappedPart if second => {
                context.error(at, "a part with <swap> elements may have one loader only");
            }
            _ if second => context.warn(at, "a second loader replaces the first one of the part"),
            _ if self.filters > 0 => {
                let message = "filters before the loader have no effect";
                context.warn_help(at, message, "put the loader first");
            }
            _ => {}
        }
        let loader = read_loader(kind, params);
        *self = Chain { loader_failed: loader.is_none(), loader, filters: self.filters, ..Chain::default() };
    }

    /// Replaces the part by the instances of a table; the filters so far transform the mesh of each instance.
    fn place_instances(&mut self, mut params: Fields, place: Where) {
        let (context, place_of_filter) = (params.context, params.own_place());
        let at = || place_of_filter.clone();
        if place != Where::Part || self.rows.is_some() {
            context.error(at(), "a table of instances can stand once in a <part> without <swap>");
        }
        let (file, reading) = match self.loader.take() {
            Some(Loader::MeshFiles { mut files, reading }) if files.len() == 1 => (files.pop(), reading),
            None => (None, MeshReading::default()),
            Some(_) => {
                context.error(at(), "instances can be made of one mesh file");
                (None, MeshReading::default())
            }
        };
        let base = Base { file, reading, transform: self.transform };
        if !params.has("filepath") {
            params.missing("filepath");
        }
        let rows = params.file("filepath").and_then(|path| read_table(context, &path, &base));
        params.done(&[]);
        let failed = rows.is_none();
        *self = Chain { loader_failed: failed, rows, filters: self.filters, ..Chain::default() };
    }

    fn rotate(&mut self, mut params: Fields, place: Where) {
        match params.rotation("rotation") {
            Some(_) if place == Where::Swap => {
                let message = "`rotate` has no effect in a <swap>; the part keeps its rotation";
                params.context.warn(params.own_place(), message);
            }
            Some(rotation) => self.transform.rotation = rotation.after(self.transform.rotation),
            None => params.missing("rotation"),
        }
        params.done(&[]);
    }

    fn scale(&mut self, mut params: Fields) {
        match params.optional("scale") {
            Some(0.0) => params.context.warn(params.own_place(), "a scale of 0 is ignored"),
            Some(scale) => {
                if scale < 0.0 {
                    let message =
                        format!("a scale of {} mirrors the part along all three axes", number(scale));
                    let help = "a scale above 0 keeps it upright; `rotate` turns it";
                    params.context.warn_help(params.own_place(), message, help);
                }
                if let Some(first) = self.scale.filter(|first| *first != 1.0 && *first != scale) {
                    let message = format!(
                        "this scale replaces the one before, {}: they do not multiply",
                        number(first)
                    );
                    let help = format!("for both write one scale of {}", number(first * scale));
                    params.context.warn_help(params.own_place(), message, help);
                }
                self.scale = Some(scale);
                self.transform.scale = scale;
            }
            None if !params.has("scale") => params.missing("scale"),
            None => {}
        }
        params.done(&[]);
    }

    fn translate(&mut self, mut params: Fields) {
        match params.vector("offset") {
            Some(offset) => {
                if let Some(first) = self.offset.filter(|first| *first != DVec3::ZERO && *first != offset) {
                    let list = |v: DVec3| v.to_array().map(number).join(";");
                    let message =
                        format!("this offset replaces the one before, {}: they do not add up", list(first));
                    let help = format!("for both write one offset of {}", list(first + offset));
                    params.context.warn_help(params.own_place(), message, help);
                }
                self.offset = Some(offset);
                self.transform.offset = offset;
            }
            None if !params.has("offset") => params.missing("offset"),
            None => {}
        }
        if let Some(mode) = params.integer("onGround") {
            self.on_ground = Some(mode);
            self.transform.on_ground = mode;
        }
        params.done(&[]);
    }
}

/// Reads the `<swap>` children of a part.
fn read_swaps(context: &Context, part: &Element, on_ground: i64) -> Vec<Swap> {
    let (mut keep_crs, mut on_ground) = (true, on_ground);
    let mut swaps = Vec::new();
    for element in part.named("swap") {
        let mut fields = Fields::new(context, &element);
        let epochs = fields.count(Key::attribute("swapStep", &COUNT_ABOVE_0), 1);
        keep_crs = fields.flag("keepCRS", keep_crs);
        let force_null = fields.text("force_null");
        if force_null.as_deref().is_some_and(|text| !matches!(text, "true" | "1")) {
            fields.warn("force_null", "removes the part whatever its value, as in HELIOS++; expected true");
        }
        let vanish = force_null.is_some();
        if vanish && element.child("filter").is_some() {
            context.warn(element.place(), "the filters of this <swap> have no effect beside `force_null`");
        }
        if fields.has("swapIndices") {
            let message = "`swapIndices` is not read; swaps follow one another in the order of the document";
            context.warn_help(
                element.name_place("swapIndices"),
                message,
                "state how long each lasts with `swapStep`",
            );
        }
        fields.ignore(&["swapIndices"]);
        fields.done(&["filter"]);
        let mut chain = Chain::default();
        if !vanish {
            for filter in element.named("filter") {
                chain.add(context, &filter, Where::Swap);
            }
        }
        on_ground = chain.on_ground.unwrap_or(on_ground);
        swaps.push(Swap {
            epochs,
            keep_crs,
            vanish,
            scale: chain.scale,
            offset: chain.offset.map(|offset| (offset, on_ground)),
            loader: chain.loader,
        });
    }
    swaps
}
