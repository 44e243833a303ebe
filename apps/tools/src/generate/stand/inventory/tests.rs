//! Tests of inventories of trees.

use super::*;

fn read_bytes(bytes: &[u8]) -> Result<(Inventory, Diagnostics)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trees.csv");
    std::fs::write(&path, bytes).unwrap();
    Inventory::read(&path)
}

fn read(text: &str) -> Result<Inventory> {
    read_bytes(text.as_bytes()).map(|(inventory, _)| inventory)
}

fn warned(text: &str) -> String {
    read_bytes(text.as_bytes()).unwrap().1.text()
}

fn refused(text: &str) -> String {
    match read(text) {
        Err(Error::Input(problems)) => problems.text(),
        other => panic!("{text}: {other:?}"),
    }
}

#[test]
fn columns_are_found_by_their_headings() {
    let table = "plot;Tree;Easting;Northing;H[m];DBH;Species;Crown_m\nA;b7;431000.5;5412000;22.5;38;beech;7\nA;;1;2;10;;;NA\n";
    let trees = read(table).unwrap().trees;
    assert_eq!(trees.len(), 2);
    let expected = Tree {
        id: "b7".into(),
        position: [431_000.5, 5_412_000.0, 0.0],
        height: 22.5,
        crown: Some(7.0),
        stem: Some(0.38),
        species: Some("beech".into()),
    };
    assert_eq!(trees[0], expected);
    assert_eq!(
        (trees[1].id.as_str(), trees[1].crown, trees[1].stem, &trees[1].species),
        ("2", None, None, &None)
    );
}

#[test]
fn crowns_are_diameters_or_radii() {
    let crown = |table: &str| read(table).unwrap().trees[0].crown;
    for table in [
        "x,y,height,crown_radius\n1,2,20,3\n",
        "x,y,height,Crown radius [cm]\n1,2,20,300\n",
        "x,y,height,CW_m\n1,2,20,6\n",
        "x,y,height,crown_radius,crown\n1,2,20,3,6\n",
    ] {
        assert_eq!((crown(table), warned(table).as_str()), (Some(6.0), ""), "{table}");
    }
    let said = warned("x,y,height,crown\n1,2,20,60\n5,6,20,30\n");
    assert!(said.contains("1 tree has a crown wider") && said.contains("60 m at a height of 20 m"), "{said}");
}

#[test]
fn fields_may_be_quoted_or_empty() {
    let table = "\"id\",\"x\",\"y\",\"height\",\"species\",\"crown\"\n\"a, b\",1,2,\"10\",\"spruce, \"\"old\"\"\",4\nc,3,4,12,beech,\n";
    let trees = read(table).unwrap().trees;
    assert_eq!((trees[0].id.as_str(), trees[0].height, trees[0].crown), ("a, b", 10.0, Some(4.0)));
    assert_eq!(trees[0].species.as_deref(), Some("spruce, \"old\""));
    assert_eq!((trees[1].species.as_deref(), trees[1].crown), (Some("beech"), None));
}

#[test]
fn a_german_spreadsheet_is_read_as_it_is_saved() {
    let text = "\u{feff}BaumNr;Rechtswert;Hochwert;Baumart;BHD_cm;Höhe_m\r\n12;475979,21;5428960,5;Fichte;38,5;22,1\r\n\
                    13;475981;5428962;Buche;;18\r\n";
    let expected = Tree {
        id: "12".into(),
        position: [475_979.21, 5_428_960.5, 0.0],
        height: 22.1,
        crown: None,
        stem: Some(0.385),
        species: Some("Fichte".into()),
    };
    assert_eq!(read(text).unwrap().trees[0], expected);
    let with_separator = text.replace('\u{feff}', "sep=;\r\n");
    assert_eq!(read(&with_separator).unwrap().trees[0], expected);
    let latin: Vec<u8> = text.chars().skip(1).map(|c| c as u32 as u8).collect();
    let (inventory, warnings) = read_bytes(&latin).unwrap();
    assert!(inventory.trees[0] == expected && warnings.text().contains("Latin-1"));
    let tabs = text.replace(';', "\t");
    assert_eq!(read(&tabs).unwrap().trees[0], expected);
    let quoted = "x,y,height\n\"1,5\",\"2,5\",\"10,5\"\n";
    assert_eq!(read(quoted).unwrap().trees[0].position[..2], [1.5, 2.5]);
}

#[test]
fn what_a_number_means_is_never_guessed_in_silence() {
    assert!(refused("x,y,height\n1,5,2,5,10,5\n").contains("decimal commas"));
    assert!(refused("x;y;height\n1,5;2.5;10\n").contains("decimal comma, line 2 with a decimal point"));
    assert!(refused("x;y;height\n1.475,5;2;10\n").contains("thousands separators"));
}

#[test]
fn stem_diameters_have_their_unit() {
    let stem = |heading: &str, value: &str| {
        let text = format!("x,y,height,{heading}\n1,2,10,{value}\n5,6,10,0.2\n");
        read(&text).map(|inventory| inventory.trees[0].stem)
    };
    for (heading, value, metres) in
        [("DBH_cm", "38", 0.38), ("dbh [mm]", "380", 0.38), ("dbh_m", "0.38", 0.38), ("dbh", "0.38", 0.38)]
    {
        let found = stem(heading, value).unwrap().unwrap();
        assert!((found - metres).abs() < 1e-12, "{heading}: {found}");
    }
    assert!(refused("x,y,height,dbh\n1,2,10,359\n").contains("is it mm?"));
    assert!(warned("x,y,height,dbh_cm\n1,2,10,359\n").contains("is the column in mm?"));
    assert!(warned("x,y,height,dbh\n1,2,10,0.2\n5,2,10,38\n").contains("read as cm"));
    assert_eq!(warned("x,y,height,dbh\n1,2,10,2.5\n5,2,10,38\n"), "");
}

#[test]
fn trees_that_are_there_twice_and_degrees_are_told() {
    let text = "id,x,y,height\na,10,20,9\nb,11,20,9\na,12,20,9\nc,10.001,20,9\n";
    let said = warned(text);
    for part in ["lines 2 and 5: x 10 y 20", "lines 2 and 4: `a`"] {
        assert!(said.contains(part), "{said}");
    }
    assert_eq!(warned("x,y,height\n10,20,9\n11,20,9\n"), "");
    assert!(warned("x,y,height\n8.6717,49.0121,9\n8.6718,49.0122,9\n").contains("longitude and latitude"));
    assert!(refused("lon,lat,height\n8.6717,49.0121,9\n").contains("project them"));
}

#[test]
fn all_reasons_are_told_at_once() {
    let said = refused("X;Y_deg;height_ns;dbh_kg;note\nfar;2;1;1;1\n");
    for part in [
        "`Y_deg` is in `deg`",
        "`height_ns` is in `ns`",
        "`dbh_kg` is in `kg`",
        "no column y, height",
        "`far` for X",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let said = warned("x,y,height,dhb,h\n1,2,10,3,4\n");
    assert!(said.starts_with("warning") && said.contains("not read: `dhb`"), "{said}");
    assert!(warned("x,y,height,dhb,h\n1,2,10,3,4\n").contains("`h` is not read"));
}

#[test]
fn names_like_those_of_columns_are_asked_about() {
    for (headings, expected) in [
        ("x,y,height,dhb", "did you mean `dbh` by `dhb`?"),
        ("x,y,height,DHB_cm", "did you mean `dbh` by `DHB_cm`?"),
        ("x,y,height,crwn[m]", "did you mean `crown` by `crwn[m]`?"),
        ("x,y,height,note,specis", "not read: `note`, `specis`"),
        ("x,y,height,note", "and optionally crown, dbh"),
        ("x,y,height,lon,lat", "not read: `lon`, `lat`"),
    ] {
        let row = "1,2,10,3,4".split(',').take(headings.split(',').count()).collect::<Vec<_>>().join(",");
        let said = warned(&format!("{headings}\n{row}\n"));
        assert!(said.contains(expected) && said.contains("trees.csv:1"), "{headings}: {said}");
    }
    // K for C.
    assert_eq!(warned("Koord_X;KOORD_Y;Height;Krown_Diameter\n1;2;10;3\n"), "");
    assert!(refused("x,y,hieght\n1,2,10\n").contains("did you mean `height` by `hieght`?"));
    // The stem diameter is there: another one is none that is misspelt.
    assert!(!warned("x,y,height,dbh,dbh2\n1,2,10,0.3,0.4\n").contains("did you mean"));
}

#[test]
fn headings_of_other_programs_are_read() {
    let height = |table: &str| read(table).unwrap().trees[0].height;
    for table in [
        "tree_x,tree_y,species,dbh,height\n1.5,2.5,beech,30,20\n",
        "POINT_X,POINT_Y,HEIGHT\n1,2,20\n",
        "x,y,Tree height (m)\n1,2,20\n",
        "gx,gy,sp,dbh.mm,Height.cm\n1,2,beech,300,2000\n",
        "Tree ID,X-Koordinate,Y-Koordinate,Baumhöhe\n7,1,2,20\n",
        "UTM_E;UTM_N;hauteur\n1;2;20\n",
        "Rechts;Hoch;Höhe\n1;2;20\n",
    ] {
        assert_eq!((height(table), warned(table).as_str()), (20.0, ""), "{table}");
    }
    assert_eq!(read("Tree ID,X,Y,H\nb7,1,2,20\n").unwrap().trees[0].id, "b7");
    assert_eq!(read("x,y,h,elevation\n1,2,20,500\n").unwrap().trees[0].position[2], 500.0);
    assert_eq!(read("x,y,h,ground\n1,2,20,500\n").unwrap().trees[0].position[2], 500.0);
    assert!(refused("x,y,height\n1,2,20,5\n").contains("4 fields, expected 3 as in the heading"));
    assert!(refused("x,y,height,note\n1,2,20\n").contains("3 fields, expected 4 as in the heading"));
    assert_eq!(height("x;y;height;\n1;2;20;\n"), 20.0);
}

#[test]
fn mistakes_are_told_with_their_lines() {
    let said = |text: &str| match read(text) {
        Err(Error::Input(problems)) => problems.text(),
        other => panic!("{other:?}"),
    };
    assert!(said("x,y\n1,2\n").contains("no column height"));
    assert!(said("x,y,height\n1,2,tall\n").contains("trees.csv:2"));
    assert!(said("x,y,height\n1,2,-4\n1,2\n").contains("expected metres"));
    assert!(said("x,y,height\n1,2,\n").contains("height is empty, expected metres from 0.01 to 200"));
    assert!(said("x,y,height_ns\n").contains("ns"));
    assert!(said("").contains("no tree"));
}
