//! Choice of the model of a tree.

use super::inventory::Tree;
use super::models::Model;
use vlscan_base::rng::{Purpose, Stream};

/// Maximum number of models to draw from, so that neighbouring trees of one size differ.
const MAX_CANDIDATES: usize = 3;
/// Weight of the difference in size, which does not change proportions, relative to that in shape, which
/// does.
const SIZE_WEIGHT: f64 = 0.3;

/// A model placed for a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    /// Index among the models.
    pub model: usize,
    /// Factor from the model's height to that of the tree.
    pub scale: f64,
    /// Factor of x and y: from the model's crown to the tree's, else that of the height.
    pub scale_xy: f64,
    /// Degrees from x to y.
    pub yaw: f64,
    /// True if the model is of the tree's species.
    pub same_species: bool,
}

/// Chooses the model for the tree with that number in the inventory: of its species, among the three whose
/// shape (crown over height) and height are nearest, drawn by seed and number. Without a model of its species
/// all are considered. The crown of a tree for which only the stem diameter is known is taken as 20 times
/// that, a usual ratio in forests.
pub(super) fn choose(tree: &Tree, number: usize, models: &[Model], stream: &Stream) -> Choice {
    let wanted = tree.species.as_deref().map(str::to_lowercase);
    let is_same = |model: &Model| {
        wanted.as_deref().is_none_or(|species| {
            // `beech`, `European beech` and `beech (old)` are models called beech.
            species.split(|c: char| !c.is_alphabetic()).any(|word| word == model.species)
        })
    };
    let same: Vec<usize> = (0..models.len()).filter(|&i| is_same(&models[i])).collect();
    let same_species = !same.is_empty();
    let mut candidates = if same_species { same } else { (0..models.len()).collect() };
    let crown = tree.crown.or(tree.stem.map(|stem| 20.0 * stem));
    let difference = |model: &Model| {
        let size = libm::log(tree.height / model.height).abs();
        let shape = crown.map_or(0.0, |crown| {
            libm::log((crown / tree.height) / (model.crown.max(1e-6) / model.height)).abs()
        });
        shape + SIZE_WEIGHT * size
    };
    candidates.sort_by(|&a, &b| difference(&models[a]).total_cmp(&difference(&models[b])).then(a.cmp(&b)));
    candidates.truncate(MAX_CANDIDATES);
    let draw = |counter: u32| stream.uniform(0, number as u64, counter);
    let model = candidates[((draw(0) * candidates.len() as f64) as usize).min(candidates.len() - 1)];
    let scale = tree.height / models[model].height;
    let widened = tree.crown.map(|crown| crown / models[model].crown).filter(|scale| scale.is_finite());
    Choice { model, scale, scale_xy: widened.unwrap_or(scale), yaw: 360.0 * draw(1), same_species }
}

/// The stream of a stand's draws.
pub(super) fn stream(seed: u64) -> Stream {
    Stream::new(seed, Purpose::SceneMaking)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::stand::stems::StemProfile;

    fn model(species: &str, height: f64, crown: f64) -> Model {
        Model {
            path: format!("{species}.obj").into(),
            species: species.into(),
            height,
            crown,
            foot: [0.0; 3],
            stem: StemProfile::default(),
        }
    }

    fn tree(species: Option<&str>, height: f64, crown: Option<f64>) -> Tree {
        Tree {
            id: "1".into(),
            position: [0.0; 3],
            height,
            crown,
            stem: None,
            species: species.map(str::to_owned),
        }
    }

    #[test]
    fn species_then_shape_then_size_decide() {
        let models = [
            model("beech", 20.0, 8.0),
            model("beech", 10.0, 4.0),
            model("beech", 30.0, 3.0),
            model("beech", 25.0, 9.0),
            model("spruce", 20.0, 8.0),
        ];
        let chosen = |tree: &Tree| {
            let mut found: Vec<usize> =
                (0..200).map(|n| choose(tree, n, &models, &stream(1)).model).collect();
            found.sort_unstable();
            found.dedup();
            found
        };
        // The slim beech is the least similar of the four.
        assert_eq!(chosen(&tree(Some("European Beech"), 18.0, Some(7.0))), [0, 1, 3]);
        assert_eq!(chosen(&tree(Some("spruce"), 40.0, None)), [4]);
        let oak = choose(&tree(Some("oak"), 10.0, None), 0, &models, &stream(1));
        assert!(!oak.same_species);
        let spruce = choose(&tree(Some("spruce"), 40.0, None), 0, &models, &stream(1));
        assert_eq!((spruce.scale, spruce.scale_xy), (2.0, 2.0));
        let wide = choose(&tree(Some("spruce"), 40.0, Some(12.0)), 0, &models, &stream(1));
        assert_eq!((wide.scale, wide.scale_xy), (2.0, 1.5));
    }

    #[test]
    fn a_seed_gives_the_same_choice_again() {
        let models = [model("a", 20.0, 8.0), model("b", 20.0, 8.0)];
        let all = |seed| {
            (0..50).map(|n| choose(&tree(None, 10.0, None), n, &models, &stream(seed))).collect::<Vec<_>>()
        };
        assert_eq!(all(7), all(7));
        assert_ne!(all(7), all(8));
    }
}
