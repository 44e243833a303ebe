//! Tests of material definitions and their resolution.

use super::*;
use crate::fixture::HELIOS;
use crate::material::Reflection;

const MTL: &str = "newmtl matte\nKd .6 .6 .6\nhelios_reflectance 50\nnewmtl glossy\nKd .4 .4 .4\nKs .4 .4 .4\nNs 20\n\
    helios_reflectance 12.5\nnewmtl slate\nKd .3 .3 .3\nKs .1 .1 .1\nhelios_spectra slate\nnewmtl lost\nKd .1 .1 .1\n\
    Ks .1 .1 .1\nhelios_spectra lost\nnewmtl mirror\nKs 1 1 1\nnewmtl plain\nnewmtl last\nKd .2 .2 .2\nKs .6 .6 .6\n\
    helios_reflectance 0.3\nhelios_classification 7\nhelios_isGround true\n";

const SHARES: Corrections = Corrections { specular_shares: true, ..HELIOS };

struct Fixture {
    folder: tempfile::TempDir,
    diagnostics: Diagnostics,
}

impl Fixture {
    fn new() -> Fixture {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("spectra")).unwrap();
        let rows = format!("{}1.0\t30\n1.1\t40\n", "\n".repeat(26));
        std::fs::write(folder.path().join("spectra/slate.txt"), rows).unwrap();
        std::fs::write(folder.path().join("m.mtl"), MTL).unwrap();
        Fixture { folder, diagnostics: Diagnostics::default() }
    }

    fn library(&self, rules: Corrections) -> Library {
        Library::new(Spectra::new(&[self.folder.path().to_path_buf()], [1064.0]), rules, 1)
    }

    fn material(&mut self, library: &mut Library, name: &str) -> Material {
        let mut names = Names::default();
        assert!(library.add_file(&self.folder.path().join("m.mtl"), &mut names, &mut self.diagnostics));
        let (index, _) = library.named(name, &names, &mut self.diagnostics);
        library.materials[index as usize].clone()
    }
}

#[test]
fn reflectance_is_verbatim_then_spectral_then_fifty() {
    let mut f = Fixture::new();
    let mut library = f.library(HELIOS);
    assert_eq!(f.material(&mut library, "glossy").reflectance, 12.5);
    assert!((f.material(&mut library, "slate").reflectance - 36.4).abs() < 1e-4);
    assert_eq!(f.material(&mut library, "plain").reflectance, 50.0);
    assert!(f.diagnostics.items().is_empty());
    assert_eq!(f.material(&mut library, "lost").reflectance, 50.0);
    let warning = &f.diagnostics.items()[0];
    assert_eq!((warning.place.as_ref().unwrap().line, f.diagnostics.items().len()), (13, 1));
    let last = f.material(&mut library, "last");
    assert_eq!((last.classification, last.is_ground, last.reflectance), (7, true, 0.3));
}

#[test]
fn the_specular_share_of_most_materials_is_zero_unless_asked_for() {
    let mut f = Fixture::new();
    let phong = |specularity, exponent| Reflection::Phong { specularity, exponent };
    let (mut helios, mut refined) = (f.library(HELIOS), f.library(SHARES));
    assert_eq!(f.material(&mut helios, "glossy").reflection, phong(0.0, 20.0));
    assert_eq!(f.material(&mut helios, "lost").reflection, phong(0.0, 10.0));
    assert_eq!(f.material(&mut refined, "glossy").reflection, phong(0.5, 20.0));
    for library in [&mut helios, &mut refined] {
        assert_eq!(f.material(library, "matte").reflection, Reflection::Lambert);
        assert_eq!(f.material(library, "plain").reflection, Reflection::Uniform);
        assert_eq!(f.material(library, "mirror").reflection, phong(1.0, 10.0));
        for (name, share) in [("slate", 0.25), ("last", 0.75)] {
            let Reflection::Phong { specularity, .. } = f.material(library, name).reflection else {
                panic!()
            };
            assert!((specularity - share).abs() < 1e-12, "{name}");
        }
    }
}

#[test]
fn reflectances_are_fractions_and_missing_ones_are_reported() {
    let mut f = Fixture::new();
    let mut library = f.library(Corrections { reflectance_fraction: true, ..HELIOS });
    assert!((f.material(&mut library, "slate").reflectance - 0.364).abs() < 1e-6, "a spectrum in per cent");
    assert_eq!(f.material(&mut library, "last").reflectance, 0.3);
    assert_eq!(f.material(&mut library, "matte").reflectance, 0.5, "50 is per cent, and reported");
    assert_eq!(f.material(&mut library, "plain").reflectance, 0.5);
    assert_eq!(f.material(&mut library, "mirror").reflectance, 0.5);
    assert_eq!(f.material(&mut library, "nowhere").reflectance, 0.5);
    let mut reported = Diagnostics::default();
    let rules = Corrections { reflectance_fraction: true, ..Corrections::NONE };
    library.issues.report(rules, &mut reported);
    let [above, missing] = reported.items() else { panic!("{}", reported.text()) };
    assert!(above.message.contains("\"matte\"") && missing.message.contains("\"plain\", \"mirror\""));
    let place = missing.place.as_ref().unwrap();
    assert!(place.path.ends_with("m.mtl") && place.excerpt == "newmtl plain", "{place:?}");
}

#[test]
fn laws_by_colours_roughness_and_rules() {
    let mut f = Fixture::new();
    let mtl = format!("{MTL}newmtl rough\nKd .1 .1 .1\nvlscan_roughness_deg 45\n");
    std::fs::write(f.folder.path().join("m.mtl"), mtl).unwrap();
    let rules = Corrections { specular_lobe: true, lambert_default: true, ..SHARES };
    let (mut refined, mut helios) = (f.library(rules), f.library(HELIOS));
    let lobes = |specularity, exponent| Reflection::Lobes { specularity, exponent, roughness: 0.0 };
    assert_eq!(f.material(&mut refined, "glossy").reflection, lobes(0.5, 20.0));
    assert_eq!(f.material(&mut refined, "mirror").reflection, lobes(1.0, 10.0));
    assert_eq!(f.material(&mut refined, "matte").reflection, Reflection::Lambert);
    assert_eq!(f.material(&mut refined, "plain").reflection, Reflection::Lambert);
    for library in [&mut refined, &mut helios] {
        let roughness = std::f64::consts::FRAC_PI_4;
        let rough = Reflection::Lobes { specularity: 0.0, exponent: 10.0, roughness };
        assert_eq!(f.material(library, "rough").reflection, rough, "asked for by a key of our own");
    }
}

#[test]
fn a_choice_without_a_name_is_the_alphabetically_first() {
    let mut f = Fixture::new();
    let mut library = f.library(HELIOS);
    let file = Some(f.folder.path().join("m.mtl"));
    let mut choice = MaterialChoice { file, ..MaterialChoice::default() };
    let first = library.chosen(&choice, 0, None, &mut f.diagnostics).unwrap();
    assert_eq!(library.materials[first[0] as usize].name, "glossy");
    choice.name = Some("none".to_owned());
    assert!(library.chosen(&choice, 0, None, &mut f.diagnostics).is_none());
    assert!(f.diagnostics.is_fatal(false));
    let before = f.diagnostics.items().len();
    let gone = MaterialChoice { file: Some(f.folder.path().join("gone.mtl")), ..MaterialChoice::default() };
    for (choice, warnings) in [(MaterialChoice::default(), 0), (gone, 1)] {
        let none = library.chosen(&choice, 0, None, &mut f.diagnostics).unwrap();
        assert_eq!(library.materials[none[0] as usize], Material::unnamed("default", HELIOS));
        assert_eq!(f.diagnostics.items().len() - before, warnings);
    }
}

#[test]
fn variants_differ_by_seed_and_stay_within_bounds() {
    let mut f = Fixture::new();
    let mut library = f.library(HELIOS);
    let file = Some(f.folder.path().join("m.mtl"));
    let name = Some("last".to_owned());
    let choice = MaterialChoice { file, name, random_variants: 50, random_range: 1.0 };
    let all = library.chosen(&choice, 3, None, &mut f.diagnostics).unwrap();
    assert_eq!(all.len(), 51);
    let shares: Vec<f64> = all[1..]
        .iter()
        .filter_map(|&i| match library.materials[i as usize].reflection {
            Reflection::Phong { specularity, .. } => Some(specularity),
            _ => None,
        })
        .collect();
    assert!(shares.iter().all(|s| (0.0..=1.0).contains(s)) && shares.len() > 10);
    assert!(shares.windows(2).any(|w| w[0] != w[1]));
}

#[test]
fn no_file_redefines_default_and_the_first_definition_counts() {
    let mut f = Fixture::new();
    std::fs::write(
        f.folder.path().join("n.mtl"),
        "newmtl default\nhelios_reflectance 9\nnewmtl matte\nKs 1 1 1\n",
    )
    .unwrap();
    let mut library = f.library(HELIOS);
    let mut names = Names::default();
    for file in ["m.mtl", "n.mtl"] {
        library.add_file(&f.folder.path().join(file), &mut names, &mut f.diagnostics);
    }
    let (d, _) = library.named(DEFAULT, &names, &mut f.diagnostics);
    let (m, known) = library.named("matte", &names, &mut f.diagnostics);
    assert_eq!(library.materials[d as usize], Material::unnamed("default", HELIOS));
    assert_eq!((known, library.materials[m as usize].reflection), (Known::Whole, Reflection::Lambert));
    assert!(!library.add_file(Path::new("/does/not/exist.mtl"), &mut names, &mut f.diagnostics));
}

#[test]
fn names_are_whole_lines_and_a_first_word_is_warned_of() {
    let mut f = Fixture::new();
    let path = f.folder.path().join("n.mtl");
    let text = "newmtl Oak bark\nhelios_classification 4\nnewmtl Oak leaf\nhelios_classification 5\nnewmtl Oak\n\
                newmtl Material #25\nhelios_classification 6\nnewmtl fir # dark\nhelios_classification 7\n";
    std::fs::write(&path, text).unwrap();
    let mut library = f.library(HELIOS);
    let mut names = Names::default();
    assert!(library.add_file(&path, &mut names, &mut f.diagnostics));
    let mut class = |name: &str| {
        let (index, known) = library.named(name, &names, &mut f.diagnostics);
        (library.materials[index as usize].classification, known)
    };
    assert_eq!([class("Oak bark").0, class("Oak leaf").0, class("Oak").0], [4, 5, 0]);
    assert_eq!([class("Material #25"), class("fir")], [(6, Known::Whole), (7, Known::Whole)]);
    assert_eq!(class("Oak twig"), (4, Known::FirstWord("Oak bark".to_owned())));
    assert_eq!(class("beech").1, Known::Nowhere);
    assert!(f.diagnostics.items().is_empty(), "{}", f.diagnostics.text());
    let mut choose = |name: &str| {
        let choice =
            MaterialChoice { file: Some(path.clone()), name: Some(name.to_owned()), ..Default::default() };
        library
            .chosen(&choice, 0, None, &mut f.diagnostics)
            .map(|all| library.materials[all[0] as usize].classification)
    };
    assert_eq!([choose("Oak leaf"), choose("fir tree"), choose("beech")], [Some(5), Some(7), None]);
    assert_eq!(f.diagnostics.items().len(), 2);
}

#[test]
fn a_transparent_material_is_warned_of_where_it_is_used_and_once() {
    let mut f = Fixture::new();
    let mtl = "newmtl pane\nhelios_reflectance 0.1\nd 0.05\nillum 4\nnewmtl unused\nd 0.5\n";
    std::fs::write(f.folder.path().join("m.mtl"), mtl).unwrap();
    let mut library = f.library(SHARES);
    f.material(&mut library, "pane");
    f.material(&mut library, "pane");
    let [complaint] = f.diagnostics.items() else { panic!("{}", f.diagnostics.text()) };
    assert!(
        complaint.message.contains("material \"pane\" is opaque")
            && complaint.message.contains("(d 0.05, illum 4)")
    );
    assert_eq!(complaint.place.as_ref().unwrap().line, 3);
}

#[test]
fn mirrors_and_panes_are_clean_unless_they_have_a_reflectance() {
    let mut f = Fixture::new();
    let mtl = "newmtl mirror\nvlscan_mirror 0.9\nnewmtl dusty\nhelios_reflectance 0.1\nvlscan_pane_sheets 2\n\
               newmtl glass\nhelios_reflectance 0.5\nd 0.25\nNi 1.4\n";
    std::fs::write(f.folder.path().join("m.mtl"), mtl).unwrap();
    let mut library = f.library(Corrections::REFINED);
    let [mirror, dusty, glass] = ["mirror", "dusty", "glass"].map(|name| f.material(&mut library, name));
    assert!(f.diagnostics.items().is_empty(), "{}", f.diagnostics.text());
    assert_eq!((mirror.reflectance, dusty.reflectance, glass.reflectance), (0.0, 0.1, 0.125));
    let shares = [mirror, dusty, glass].map(|material| material.optics.unwrap().share);
    assert_eq!(shares, [1.0, 0.9, 0.75]);
}

#[test]
fn the_opaque_share_of_a_pane_of_pictures_reflects_the_default_with_a_warning() {
    let mut f = Fixture::new();
    let mtl = "newmtl veil\nd 0.25\nnewmtl glass\nd 0\nillum 4\n";
    std::fs::write(f.folder.path().join("m.mtl"), mtl).unwrap();
    let mut library = f.library(Corrections::REFINED);
    let [veil, glass] = ["veil", "glass"].map(|name| f.material(&mut library, name));
    assert_eq!((veil.reflectance, glass.reflectance), (0.125, 0.0));
    assert_eq!([veil, glass].map(|material| material.optics.unwrap().share), [0.75, 1.0]);
    let mut missing = Diagnostics::default();
    library.issues.report(Corrections::REFINED, &mut missing);
    let text = missing.text();
    assert!(text.contains("\"veil\" has no reflectance") && !text.contains("glass"), "{text}");
}

#[test]
fn dust_in_per_cent_leaves_the_rest_of_the_light_to_a_mirror() {
    let mut f = Fixture::new();
    let mtl = "newmtl dusty\nhelios_reflectance 20\nvlscan_mirror 1\n";
    std::fs::write(f.folder.path().join("m.mtl"), mtl).unwrap();
    let mut library = f.library(Corrections::NONE);
    let dusty = f.material(&mut library, "dusty");
    assert_eq!((dusty.reflectance, dusty.optics.unwrap().share), (20.0, 0.8));
}
