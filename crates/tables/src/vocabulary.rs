//! The vocabulary of column names.

use super::dimension::Dimension;

macro_rules! quantities {
    ($($quantity:ident $name:literal $dimension:ident, $synonyms:literal;)*) => {
        /// The quantity of a column.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Quantity {
            $(#[doc = concat!("Written as `", $name, "`.")] $quantity,)*
        }

        impl Quantity {
            /// All quantities.
            pub const ALL: &'static [Quantity] = &[$(Quantity::$quantity),*];
        }

        static ENTRIES: &[Entry] = &[$(Entry {
            name: $name,
            dimension: Dimension::$dimension,
            synonyms: $synonyms,
        }),*];
    };
}

struct Entry {
    /// The name in documentation and messages.
    name: &'static str,
    dimension: Dimension,
    /// All names in the form of [`plain`]. If a table has several of them, the first one of this list counts.
    synonyms: &'static str,
}

quantities! {
    Time "time" Time, "gpstime time t timestamp utctime gpsseconds gpssow gpstow sow tow secondsofweek timeofweek unixtime posixtime zeit";
    X "x" Length, "x easting east e xcoordinate xcoord coordx pointx xkoordinate koordx xkoord rechtswert ostwert rw \
        xutm utmx utme grideasting rechts \
        treex positionx posx xposition posepositionx poseposepositionx prsrx originx ox tx gx px";
    Y "y" Length, "y northing north n ycoordinate ycoord coordy pointy ykoordinate koordy ykoord hochwert nordwert hw \
        yutm utmy utmn gridnorthing hoch \
        treey positiony posy yposition posepositiony poseposepositiony prsry originy oy ty gy py";
    Z "z" Length, "z elevation elev height altitude alt zcoordinate zcoord coordz pointz zkoordinate koordz zkoord \
        höhe hoehe hauteur h up orthometricheight orthoheight orthohgt hmsl ellheight \
        ellipsoidheight ellipsoidalheight ellipsoidhgt hell hgt hght treez \
        positionz posz zposition posepositionz poseposepositionz prsrz originz oz tz gz pz";
    Latitude "latitude" Angle, "latitude lat breite breitengrad";
    Longitude "longitude" Angle, "longitude lon long lng länge laenge längengrad laengengrad";
    Roll "roll" Angle, "roll rollangle";
    Pitch "pitch" Angle, "pitch pitchangle";
    Yaw "yaw" Angle, "yaw heading hdg head azimuth yawangle headingangle trueheading platformheading";
    QuaternionW "qw" Ratio, "qw qrsw quatw quaternionw orientationw rotationw rotw poseorientationw poseposeorientationw q0";
    QuaternionX "qx" Ratio, "qx qrsx quatx quaternionx orientationx rotationx rotx poseorientationx poseposeorientationx q1";
    QuaternionY "qy" Ratio, "qy qrsy quaty quaterniony orientationy rotationy roty poseorientationy poseposeorientationy q2";
    QuaternionZ "qz" Ratio, "qz qrsz quatz quaternionz orientationz rotationz rotz poseorientationz poseposeorientationz q3";
    File "file" Text, "file filename filepath path mesh meshfile model modelfile obj datei";
    Scale "scale" Ratio, "scale scalefactor factor massstab maßstab";
    ScaleXy "scale_xy" Ratio, "scalexy";
    TreeId "id" Text, "id treeid tree treenr treeno treenumber treetag tag name label nr no number baum baumnr baumid baumnummer nummer";
    TreeHeight "height" Length, "height h treeheight totalheight heighttotal ht hgt höhe hoehe baumhöhe baumhoehe \
        scheitelhöhe scheitelhoehe hauteur";
    Ground "ground" Length, "ground groundheight groundelevation geländehöhe gelaendehoehe";
    Crown "crown" Length, "crown crowndiameter crownwidth crowndiam crownd cd cw \
        krone kronendurchmesser kronenbreite kd";
    CrownRadius "crown_radius" Length, "crownradius crownrad kronenradius";
    Stem "dbh" Length, "dbh bhd diameter stemdiameter diam diameteratbreastheight d13 brusthöhendurchmesser \
        brusthoehendurchmesser durchmesser";
    Species "species" Text, "species treespecies type sp speciescode spcode art baumart holzart";
    NormalX "nx" Ratio, "nx normalx";
    NormalY "ny" Ratio, "ny normaly";
    NormalZ "nz" Ratio, "nz normalz";
    Intensity "intensity" Ratio, "heliosamplitude intensity amplitude";
    Class "class" Count, "surfaceclass classification class label";
    ReturnNumber "return_number" Count, "returnnumber return";
    NumberOfReturns "number_of_returns" Count, "numberofreturns numreturns";
    ScanAngle "scan_angle" Angle, "scanangle scananglerank";
    Object "object" Text, "objectid hitobjectid object partid part treeid instanceid instance";
    Leg "leg" Count, "leg";
    Source "leg" Count, "leg pointsourceid";
    Device "device" Count, "device channel";
    Channel "channel" Count, "device channel userdata scannerchannel ring";
    LightPath "path" Count, "path";
    DirectionX "dx" Ratio, "dx directionx dirx beamdirectionx";
    DirectionY "dy" Ratio, "dy directiony diry beamdirectiony";
    DirectionZ "dz" Ratio, "dz directionz dirz beamdirectionz";
    Pulse "pulse" Count, "pulse pulsenumber number";
    Step "step" Count, "step";
    LowX "x_low" Length, "xlow";
    LowY "y_low" Length, "ylow";
    LowZ "z_low" Length, "zlow";
    ExactW "exact_qw" Ratio, "exactqw";
    ExactX "exact_qx" Ratio, "exactqx";
    ExactY "exact_qy" Ratio, "exactqy";
    ExactZ "exact_qz" Ratio, "exactqz";
    RangeError "range_error" Length, "rangeerror";
    Divergence "divergence" Angle, "divergence beamdivergence";
    StartDivergence "start_divergence" Angle, "startdivergence";
    Epoch "epoch" Count, "epoch play";
    ReportedW "reported_qw" Ratio, "reportedqw";
    ReportedX "reported_qx" Ratio, "reportedqx";
    ReportedY "reported_qy" Ratio, "reportedqy";
    ReportedZ "reported_qz" Ratio, "reportedqz";
    OriginErrorX "x_error" Length, "xerror";
    OriginErrorY "y_error" Length, "yerror";
    OriginErrorZ "z_error" Length, "zerror";
    BeamAzimuth "beam_azimuth" Angle, "beamazimuth azimuth";
    BeamElevation "beam_elevation" Angle, "beamelevation elevation";
}

/// Names, in the form of [`plain`], of columns that tables often have and that most readers here do not use.
const UNUSED: &str = "a acceleration alpha azimuthangle b beamdirectionx beamdirectiony beamdirectionz beamoriginx \
    beamoriginy beamoriginz blue classflags cog comment course curvature date day distance echowidth edgeofflightline fid fix \
    doppler dopplerwidth footprintfraction frame frameid flightline fullwaveindex g gdop gpsweek green hdop headerframeid headerseq headerstamp \
    heightaboveground hour id incidenceangle index infrared keypoint minute mode month nir nsats numsats overlap path pathorder \
    pdop point pointid primitive pulsenumber q quality r range record red reflectance rgb rgba sat satellites sats scandirectionflag scannerx \
    scannery scannerz second seq sequence sog status subray surfacex surfacey surfacez synthetic truerange truex truey truez \
    undulation utcdate vdop wanderangle week width withheld year";

/// Ends of names, in the form of [`plain`], of accuracies, velocities and rates, which no table here uses.
const UNUSED_ENDS: [&str; 12] = [
    "sd",
    "std",
    "stddev",
    "sigma",
    "accuracy",
    "covariance",
    "velocity",
    "speed",
    "rate",
    "acceleration",
    "separation",
    "bias",
];

/// Beginnings of names, in the form of [`plain`], of velocities, rates and biases of inertial sensors.
const UNUSED_STARTS: [&str; 16] = [
    "vrsr",
    "bwrss",
    "bars",
    "vel",
    "gyro",
    "acc",
    "sd",
    "std",
    "sigma",
    "speed",
    "cov",
    "twist",
    "angularvel",
    "linearvel",
    "linearacc",
    "wander",
];

/// Minimum number of letters of a name for which a similar one is looked for.
const MIN_SIMILAR: usize = 3;
/// Maximum number of these letters.
const MAX_SIMILAR: usize = 60;
/// Minimum number of letters of a name of which two may be wrong.
const LONG_NAME: usize = 6;

/// True if a name in the form of [`plain`] is one that tables often have and that no table here uses.
pub fn is_usually_unused(name: &str) -> bool {
    UNUSED.split_ascii_whitespace().any(|unused| unused == name)
        || matches!(name, "vx" | "vy" | "vz" | "ve" | "vn" | "vu" | "wx" | "wy" | "wz" | "ax" | "ay" | "az")
        || UNUSED_ENDS.iter().any(|end| name.len() > end.len() && name.ends_with(end))
        || UNUSED_STARTS.iter().any(|start| name.starts_with(start))
}

/// A name in the form in which names are compared: lower case, without blanks, punctuation and quotes, and
/// without the prefixes of CloudCompare's scalar fields and of exported ROS topics.
pub fn plain(name: &str) -> String {
    const IGNORED: [char; 14] =
        ['_', '-', '.', '"', '\'', '`', '#', '%', '/', ':', '\u{feff}', '*', '+', ','];
    let is_kept = |c: &char| !c.is_whitespace() && !IGNORED.contains(c);
    let name: String = name.chars().filter(is_kept).flat_map(char::to_lowercase).collect();
    let rest = ["scalar", "field"].iter().find_map(|prefix| name.strip_prefix(prefix));
    rest.filter(|rest| !rest.is_empty()).map(str::to_owned).unwrap_or(name)
}

/// The one of `names` that a name in the form of [`plain`] most likely stands for: it begins alike, and one
/// letter differs, or two in a long name. `None` for one of the names. Another last letter often is another
/// axis.
pub fn similar_name<'n>(name: &str, names: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    let letters = name.chars().count();
    if !(MIN_SIMILAR..=MAX_SIMILAR).contains(&letters) {
        return None;
    }
    let most = if letters < LONG_NAME { 1 } else { 2 };
    let is_other_axis = |other: &str| {
        let stem = |text: &str| text.chars().take(letters - 1).collect::<String>();
        other != name && other.chars().count() == letters && stem(other) == stem(name)
    };
    let similar = names.into_iter().filter(|other| other.chars().next() == name.chars().next());
    let similar = similar.filter(|other| !is_other_axis(other));
    let distances = similar.map(|other| (strsim::osa_distance(name, other), other));
    let near = distances.filter(|(distance, _)| *distance <= most).min_by_key(|near| near.0);
    near.filter(|(distance, _)| *distance > 0).map(|(_, other)| other)
}

impl Quantity {
    /// The name in documentation and messages.
    pub fn name(self) -> &'static str {
        ENTRIES[self as usize].name
    }

    /// Dimension of the values.
    pub fn dimension(self) -> Dimension {
        ENTRIES[self as usize].dimension
    }

    /// All names, in the form of [`plain`]; the first ones take precedence.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        ENTRIES[self as usize].synonyms.split_ascii_whitespace()
    }

    /// Position of a name in the form of [`plain`] among the names of this quantity.
    pub fn rank(self, plain: &str) -> Option<usize> {
        self.names().position(|name| name == plain)
    }

    /// The first of `quantities` that has the name `plain`. Names that differ by K for C (`Koord_X`, `Krown`)
    /// are accepted if only one quantity has them.
    pub fn of_name(plain: &str, quantities: impl IntoIterator<Item = Quantity> + Clone) -> Option<Quantity> {
        let exact = quantities.clone().into_iter().find(|quantity| quantity.rank(plain).is_some());
        exact.or_else(|| {
            let with_k = |name: &str| name.replace('c', "k");
            let reference = with_k(plain);
            let has = |quantity: &Quantity| {
                plain.len() > 2 && quantity.names().any(|name| with_k(name) == reference)
            };
            let mut similar = quantities.into_iter().filter(has);
            similar.next().filter(|_| similar.next().is_none())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_names_are_plain_and_occur_once_in_a_quantity() {
        for quantity in Quantity::ALL {
            let names: Vec<&str> = quantity.names().collect();
            assert!(names.iter().all(|name| plain(name) == *name), "{quantity:?}: {names:?}");
            assert!(names.contains(&&*plain(quantity.name())), "{quantity:?}");
            assert!(names.iter().all(|name| names.iter().filter(|other| *other == name).count() == 1));
        }
    }

    #[test]
    fn columns_of_receivers_are_usually_unused() {
        for name in ["GPSWeek", "Week", "sigma_x", "SDEast", "speed", "speed_north", "sats", "hdop", "cog"] {
            assert!(is_usually_unused(&plain(name)), "{name}");
        }
        assert!(!is_usually_unused("spot") && !is_usually_unused("depth"));
    }

    #[test]
    fn similar_names_are_misspelt_ones() {
        let near = |name| similar_name(name, Quantity::ALL.iter().flat_map(|quantity| quantity.names()));
        for (name, expected) in [
            ("hieght", "height"),
            ("hedaing", "heading"),
            ("dhb", "dbh"),
            ("crwn", "crown"),
            ("divergense", "divergence"),
            ("latitud", "latitude"),
            ("dzz", "dz"),
        ] {
            assert_eq!(near(name), Some(expected), "{name}");
        }
        for name in ["height", "utmz", "gridheading", "crownarea", "nq", "spot", ""] {
            assert_eq!(near(name), None, "{name}");
        }
    }

    #[test]
    fn spellings_of_other_programs_are_one_name() {
        for (name, expected) in [
            ("Tree ID", "treeid"),
            ("X-Koordinate", "xkoordinate"),
            ("POINT_X", "pointx"),
            ("H-Ell", "hell"),
            ("ELLIPSOID HEIGHT", "ellipsoidheight"),
            ("scalar_Normal_X", "normalx"),
            ("field.pose.orientation.x", "poseorientationx"),
            ("#timestamp", "timestamp"),
            ("field", "field"),
        ] {
            assert_eq!(plain(name), expected);
        }
    }
}
