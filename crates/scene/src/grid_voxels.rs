//! Attributes and surfaces of the voxels of a grid, in as few bytes as keep them exactly.

use super::surfaces::SurfaceIds;
use super::voxel::{Voxel, VoxelKind};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter, Checksum, vec_bytes};

/// Attributes of the voxels of a grid, in the order of their numbers.
#[derive(Clone, Debug, Default)]
pub struct GridVoxels {
    count: usize,
    densities: Densities,
    /// Unit normals; empty if no voxel has one. (0, 0, 0) stands for none.
    normals: Vec<[f32; 3]>,
    kinds: Kinds,
    /// The index in the scene's surfaces of each voxel.
    pub surfaces: GridSurfaces,
}

/// Plant area densities, 1/m.
#[derive(Clone, Debug)]
enum Densities {
    /// All are the same.
    Same(f64),
    /// Decimal numbers: whole numbers to be divided by this power of ten; [`NOT_A_NUMBER`] stands for NaN.
    Decimal(u32, Vec<u32>),
    Double(Vec<f64>),
}

/// NaN among decimal numbers.
const NOT_A_NUMBER: u32 = u32::MAX;

/// Maximum number of digits after the point of decimal numbers. Whole numbers of 32 bits and powers of ten up
/// to this one have exact doubles, so that their quotient is the double nearest to the decimal number, as it
/// is read from text.
const MAX_DIGITS: u32 = 9;

impl Default for Densities {
    fn default() -> Densities {
        Densities::Same(0.0)
    }
}

/// How the voxels interact with rays.
#[derive(Clone, Debug, Default)]
struct Kinds {
    /// The kind of voxels without a bit, and of those with one.
    of_bit: [VoxelKind; 2],
    /// A bit per voxel; empty if none is set.
    bits: Vec<u64>,
}

/// The index in the scene's surfaces of each voxel of a grid.
#[derive(Clone, Debug)]
pub enum GridSurfaces {
    /// Surfaces that the voxels have in turn, at least one.
    InTurn(Vec<u32>),
    /// One for each voxel.
    Each(SurfaceIds),
}

impl Default for GridSurfaces {
    fn default() -> GridSurfaces {
        GridSurfaces::InTurn(vec![0])
    }
}

/// Attributes of voxels without their arrays, as in a file. Values are stored in the order of the fields.
#[derive(Serialize, Deserialize)]
struct StoredValues<'a> {
    count: usize,
    /// Bits of the density of all voxels if they have the same one.
    same_density: Option<u64>,
    /// Digits after the point of decimal densities.
    digits: Option<u32>,
    /// The two kinds as numbers.
    kinds: [u32; 2],
    surfaces_in_turn: Option<Cow<'a, [u32]>>,
}

/// `whole` over a power of ten.
#[inline(always)]
fn decimal(digits: u32, whole: u32) -> f64 {
    const POWERS: [f64; MAX_DIGITS as usize + 1] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];
    if whole == NOT_A_NUMBER { f64::NAN } else { f64::from(whole) / POWERS[digits as usize] }
}

/// The whole number that stands for `value` with this many digits, if there is one.
fn whole(digits: u32, value: f64) -> Option<u32> {
    if value.is_nan() {
        return Some(NOT_A_NUMBER);
    }
    let whole = (value * f64::from(10u32.pow(digits))).round() as u32;
    (whole != NOT_A_NUMBER && decimal(digits, whole).to_bits() == value.to_bits()).then_some(whole)
}

impl Densities {
    fn get(&self, i: usize) -> f64 {
        match self {
            Densities::Same(value) => *value,
            Densities::Decimal(digits, all) => decimal(*digits, all[i]),
            Densities::Double(all) => all[i],
        }
    }

    /// Appends a density to `count` others.
    fn push(&mut self, count: usize, density: f64) {
        match self {
            Densities::Same(value) if count == 0 => *value = density,
            Densities::Same(value) if value.to_bits() == density.to_bits() => {}
            Densities::Decimal(digits, all) if let Some(whole) = whole(*digits, density) => all.push(whole),
            Densities::Double(all) => all.push(density),
            Densities::Same(_) | Densities::Decimal(..) => {
                *self = self.wider(count, density);
                self.push(count, density);
            }
        }
    }

    /// The numbers in a form that can have `density`, too.
    #[cold]
    fn wider(&self, count: usize, density: f64) -> Densities {
        let least = if let Densities::Decimal(digits, _) = self { *digits } else { 0 };
        let fits = |digits: &u32| whole(*digits, density).is_some();
        let all_in =
            |digits: u32| (0..count).map(|i| whole(digits, self.get(i))).collect::<Option<Vec<u32>>>();
        (least..=MAX_DIGITS)
            .filter(fits)
            .find_map(|digits| all_in(digits).map(|all| Densities::Decimal(digits, all)))
            .unwrap_or_else(|| Densities::Double((0..count).map(|i| self.get(i)).collect()))
    }
}

impl Kinds {
    fn get(&self, i: usize) -> VoxelKind {
        self.of_bit[usize::from(self.bits.get(i / 64).is_some_and(|word| word >> (i % 64) & 1 == 1))]
    }

    /// Appends a kind to `count` others; false if it is a third one.
    fn push(&mut self, count: usize, kind: VoxelKind) -> bool {
        if count == 0 {
            self.of_bit = [kind; 2];
        }
        if kind == self.of_bit[0] {
            return true;
        }
        if self.bits.is_empty() {
            self.of_bit[1] = kind;
        }
        self.bits.resize(count / 64 + 1, 0);
        self.bits[count / 64] |= 1 << (count % 64);
        self.of_bit[1] == kind
    }
}

impl GridSurfaces {
    /// The surface of voxel `i`, counted from the grid's first.
    #[inline]
    pub fn get(&self, i: usize) -> Option<u32> {
        match self {
            GridSurfaces::InTurn(all) => all.get(i % all.len()).copied(),
            GridSurfaces::Each(all) => all.get(i),
        }
    }

    /// The surfaces of `count` voxels, and the number of voxels with each.
    pub fn counts(&self, count: usize) -> Vec<(u32, u64)> {
        match self {
            GridSurfaces::InTurn(all) => {
                let of = |(n, surface): (usize, &u32)| {
                    (*surface, (count + all.len() - 1 - n) as u64 / all.len() as u64)
                };
                all.iter().enumerate().map(of).collect()
            }
            GridSurfaces::Each(all) => {
                let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
                all.iter().for_each(|surface| *counts.entry(surface).or_default() += 1);
                counts.into_iter().collect()
            }
        }
    }

    /// Replaces every surface by what `by` returns for it.
    pub(super) fn replace(&mut self, by: impl FnMut(u32) -> u32) {
        *self = match self {
            GridSurfaces::InTurn(all) => GridSurfaces::InTurn(all.iter().copied().map(by).collect()),
            GridSurfaces::Each(all) => GridSurfaces::Each(all.iter().map(by).collect()),
        };
    }

    fn memory(&self) -> usize {
        match self {
            GridSurfaces::InTurn(all) => vec_bytes(all),
            GridSurfaces::Each(all) => all.memory(),
        }
    }
}

impl GridVoxels {
    /// Number of voxels.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True if there are no voxels.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The attributes of voxel `i`, counted from the grid's first.
    #[inline]
    pub fn get(&self, i: usize) -> Voxel {
        let normal = self.normals.get(i).copied().unwrap_or_default();
        Voxel::new(self.densities.get(i), normal, self.kinds.get(i))
    }

    /// Appends the attributes of a voxel. Returns false, and then cannot be used further, if it is of a third
    /// kind.
    pub fn push(&mut self, voxel: &Voxel) -> bool {
        self.densities.push(self.count, voxel.density);
        let normal = voxel.stored_normal();
        if normal != [0.0; 3] && self.normals.is_empty() {
            self.normals.resize(self.count, [0.0; 3]);
            self.normals.push(normal);
        } else if !self.normals.is_empty() {
            self.normals.push(normal);
        }
        let is_known = self.kinds.push(self.count, voxel.kind());
        self.count += 1;
        is_known
    }

    /// Gives the voxels their surfaces, and releases memory that is not in use.
    pub(super) fn complete(&mut self, mut surfaces: GridSurfaces) {
        if let GridSurfaces::InTurn(all) = &mut surfaces {
            all.truncate(self.count);
        }
        self.surfaces = surfaces;
        match &mut self.densities {
            Densities::Same(_) => {}
            Densities::Decimal(_, all) => all.shrink_to_fit(),
            Densities::Double(all) => all.shrink_to_fit(),
        }
        self.normals.shrink_to_fit();
        self.kinds.bits.shrink_to_fit();
    }

    /// Memory, bytes.
    pub fn memory(&self) -> usize {
        let densities = match &self.densities {
            Densities::Same(_) => 0,
            Densities::Decimal(_, all) => vec_bytes(all),
            Densities::Double(all) => vec_bytes(all),
        };
        size_of::<GridVoxels>()
            + densities
            + vec_bytes(&self.normals)
            + vec_bytes(&self.kinds.bits)
            + self.surfaces.memory()
    }

    /// Adds the values to a checksum.
    pub(super) fn add_to(&self, sum: &mut Checksum) {
        let kinds = self.kinds.of_bit.map(|kind| kind as u32);
        match &self.densities {
            Densities::Same(value) => sum.debug(&(self.count, kinds, value.to_bits())),
            Densities::Decimal(digits, all) => {
                sum.debug(&(self.count, kinds, digits));
                sum.array(all);
            }
            Densities::Double(all) => sum.array(all),
        }
        sum.array(&self.normals);
        sum.array(&self.kinds.bits);
        match &self.surfaces {
            GridSurfaces::InTurn(all) => sum.array(all),
            GridSurfaces::Each(SurfaceIds::Narrow(all)) => sum.array(all),
            GridSurfaces::Each(SurfaceIds::Wide(all)) => sum.array(all),
        }
    }

    /// Writes the values as arrays of a file, with names that begin with `name`.
    pub(super) fn pack(&self, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
        let (same_density, digits) = match &self.densities {
            Densities::Same(value) => (Some(value.to_bits()), None),
            Densities::Decimal(digits, _) => (None, Some(*digits)),
            Densities::Double(_) => (None, None),
        };
        let surfaces_in_turn = match &self.surfaces {
            GridSurfaces::InTurn(all) => Some(Cow::Borrowed(&all[..])),
            GridSurfaces::Each(_) => None,
        };
        let kinds = self.kinds.of_bit.map(|kind| kind as u32);
        let values = StoredValues { count: self.count, same_density, digits, kinds, surfaces_in_turn };
        out.value(format!("{name}.values"), &values)?;
        match &self.densities {
            Densities::Same(_) => {}
            Densities::Decimal(_, all) => out.array(format!("{name}.densities"), all)?,
            Densities::Double(all) => out.array(format!("{name}.densities"), all)?,
        }
        out.array(format!("{name}.normals"), &self.normals)?;
        out.array(format!("{name}.kinds"), &self.kinds.bits)?;
        match &self.surfaces {
            GridSurfaces::InTurn(_) => Ok(()),
            GridSurfaces::Each(all) => all.pack(format!("{name}.surfaces"), out),
        }
    }

    /// Reads the values of [`GridVoxels::pack`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub(super) fn unpack(name: &str, file: &ArrayFile) -> Result<GridVoxels> {
        let values: StoredValues<'static> = file.value(&format!("{name}.values"))?;
        let (count, kinds) = (values.count, values.kinds.map(VoxelKind::of_number));
        let densities = match (values.same_density, values.digits) {
            (Some(bits), _) => Densities::Same(f64::from_bits(bits)),
            (None, Some(digits)) => Densities::Decimal(digits, file.array(&format!("{name}.densities"))?),
            (None, None) => Densities::Double(file.array(&format!("{name}.densities"))?),
        };
        let voxels = GridVoxels {
            count,
            densities,
            normals: file.array(&format!("{name}.normals"))?,
            kinds: Kinds { of_bit: kinds, bits: file.array(&format!("{name}.kinds"))? },
            surfaces: match values.surfaces_in_turn {
                Some(all) => GridSurfaces::InTurn(all.into_owned()),
                None => GridSurfaces::Each(SurfaceIds::unpack(&format!("{name}.surfaces"), file)?),
            },
        };
        let are_densities = match &voxels.densities {
            Densities::Same(_) => true,
            Densities::Decimal(digits, all) => all.len() == count && *digits <= MAX_DIGITS,
            Densities::Double(all) => all.len() == count,
        };
        let are_surfaces = match &voxels.surfaces {
            GridSurfaces::InTurn(all) => !all.is_empty(),
            GridSurfaces::Each(all) => all.len() == count,
        };
        let are_normals = voxels.normals.is_empty() || voxels.normals.len() == count;
        // Numbers of no kind are read as another one.
        let are_kinds =
            kinds.map(|kind| kind as u32) == values.kinds && voxels.kinds.bits.len() <= count.div_ceil(64);
        if are_densities && are_surfaces && are_normals && are_kinds {
            return Ok(voxels);
        }
        Err(file.refuse("voxel metadata does not match the stored arrays"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::DVec3;

    fn of(all: &[Voxel]) -> GridVoxels {
        let mut voxels = GridVoxels::default();
        all.iter().for_each(|voxel| assert!(voxels.push(voxel)));
        voxels
    }

    fn same(a: Voxel, b: Voxel) -> bool {
        a.density.to_bits() == b.density.to_bits() && a.normal() == b.normal() && a.kind() == b.kind()
    }

    fn voxels() -> impl Strategy<Value = Vec<Voxel>> {
        let text = prop_oneof![
            3 => Just("1.2".to_owned()),
            2 => (0u32..50_000, 0usize..7).prop_map(|(n, digits)| format!("{:.digits$}", f64::from(n) / 3.0)),
            1 => prop_oneof![Just("NaN"), Just("0"), Just("4294967295"), Just("1e-20"), Just("-0")].prop_map(str::to_owned),
        ];
        let kind = prop_oneof![Just(VoxelKind::Opaque), Just(VoxelKind::Transparent)];
        let normal = prop::option::of(prop::array::uniform3(-1.0..1.0f64)).prop_map(|n| n.map(DVec3::from));
        let foliage = (text, kind).prop_map(|(text, kind)| Voxel::of_plants(text.parse().unwrap(), kind));
        let cloud = normal.prop_map(Voxel::of_points);
        prop_oneof![prop::collection::vec(foliage, 1..200), prop::collection::vec(cloud, 1..200)]
    }

    proptest! {
        #[test]
        fn voxels_stay_what_they_are(all in voxels()) {
            let voxels = of(&all);
            prop_assert_eq!(voxels.len(), all.len());
            for (i, voxel) in all.iter().enumerate() {
                prop_assert!(same(voxels.get(i), *voxel), "{:?} for {:?}", voxels.get(i), voxel);
            }
        }
    }

    #[test]
    fn densities_take_few_bytes() {
        let plants = |densities: &[&str]| {
            let all: Vec<Voxel> = densities
                .iter()
                .cycle()
                .take(10_000)
                .map(|d| Voxel::of_plants(d.parse().unwrap(), VoxelKind::Transmittive))
                .collect();
            let mut voxels = of(&all);
            voxels.complete(GridSurfaces::default());
            (voxels.memory() as f64 / 10_000.0).round() as usize
        };
        assert_eq!(plants(&["0.1"]), 0);
        assert_eq!(plants(&["0.1", "1.2345", "NaN", "17"]), 4);
        assert_eq!(plants(&["0.1", "1.23456789012"]), 8);
    }

    #[test]
    fn surfaces_in_turn_are_counted_as_each() {
        for (surfaces, count) in [(vec![4], 7), (vec![4, 2, 9], 7), (vec![1, 2], 1)] {
            let all = GridSurfaces::InTurn(surfaces);
            let found: Vec<u32> = (0..count).map(|i| all.get(i).unwrap()).collect();
            let counts = all.counts(count);
            assert!(counts.iter().all(|(s, n)| *n == found.iter().filter(|f| *f == s).count() as u64));
            assert_eq!(counts.iter().map(|(_, n)| n).sum::<u64>(), count as u64);
        }
    }

    #[test]
    fn a_third_kind_is_refused() {
        use VoxelKind::{Opaque, Transmittive, Transparent};
        let mut voxels = of(&[Opaque, Transparent].map(|kind| Voxel::of_plants(1.0, kind)));
        assert!(!voxels.push(&Voxel::of_plants(1.0, Transmittive)));
    }
}
