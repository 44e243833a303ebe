//! Parts that are in memory although others are tiles.

use crate::builder::SceneBuilder;
use crate::ground::{Body, LoadedPart};
use vlscan_base::quantity;

/// Reports parts that are to be dropped to the ground, all of which would have to be in memory.
pub(super) fn refuse_on_ground(scene: &mut SceneBuilder, parts: &[LoadedPart]) {
    for part in parts.iter().filter(|part| part.on_ground != 0) {
        let message =
            format!("part \"{}\" is dropped to the ground, for which --scene-memory keeps no scene", part.id);
        scene
            .diagnostics
            .error(part.place.clone(), message)
            .help("give the part its height in the offset in place of onGround, or leave out --scene-memory");
    }
}

/// Maximum number of parts that a warning lists.
const MAX_LISTED: usize = 3;

/// Warns of parts that are not tiles and need more memory than tiles may use.
pub(super) fn warn_of_memory(scene: &mut SceneBuilder, parts: &[LoadedPart], limit: u64) {
    let all = scene.memory();
    if all <= limit {
        return;
    }
    let bytes_of = |part: &LoadedPart| match &part.body {
        Body::Stored(extent) => scene.memory_within(extent),
        Body::Instance(_) => 0,
    };
    let mut largest: Vec<(u64, &LoadedPart)> = parts.iter().map(|part| (bytes_of(part), part)).collect();
    largest.sort_by_key(|(bytes, _)| std::cmp::Reverse(*bytes));
    let place = largest.first().and_then(|(_, part)| part.place.clone());
    let listed = largest.iter().take(MAX_LISTED).filter(|(bytes, _)| *bytes > 0);
    let listed: Vec<String> =
        listed.map(|(bytes, part)| format!("\"{}\" {}", part.id, quantity::bytes(*bytes))).collect();
    let message = format!(
        "--scene-memory is {}, but parts that cannot be tiles stay in memory with {}: {}",
        quantity::bytes(limit),
        quantity::bytes(all),
        listed.join(", ")
    );
    let help = "parts that move, are swapped or dropped to the ground, and meshes that several parts share, \
                are no tiles";
    scene.diagnostics.warn(place, message).help(help);
}
