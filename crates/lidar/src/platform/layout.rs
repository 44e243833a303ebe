//! Columns of poses: which column of a row holds which component, and its unit.

use super::attitude::{MATRIX_HELP, of_matrix, of_quaternion};
use super::layout_error::{MAX_COLUMNS, PoseLayoutError};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity;
use vlscan_geom::{Rotation, radians};
use vlscan_tables::input::arrow::TableField;
use vlscan_tables::input::rows::{Row, RowError};
use vlscan_tables::{Dimension, Headings, Quantity, Schema, Use, join_units, plain, split_unit};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseColumn {
    Time,
    Roll,
    Pitch,
    Yaw,
    X,
    Y,
    Z,
}

/// The columns of a pose on a grid, in the order of trajectory files without names.
pub(super) const POSE_COLUMNS: [PoseColumn; 7] = [
    PoseColumn::Time,
    PoseColumn::Roll,
    PoseColumn::Pitch,
    PoseColumn::Yaw,
    PoseColumn::X,
    PoseColumn::Y,
    PoseColumn::Z,
];

pub(super) const ANGLES: [PoseColumn; 3] = [PoseColumn::Roll, PoseColumn::Pitch, PoseColumn::Yaw];

/// The columns of trajectories. Which of them are needed depends on the others.
pub(super) const SCHEMA: Schema = Schema {
    columns: &[
        (Quantity::Time, Use::Optional),
        (Quantity::X, Use::Optional),
        (Quantity::Y, Use::Optional),
        (Quantity::Z, Use::Optional),
        (Quantity::Roll, Use::Optional),
        (Quantity::Pitch, Use::Optional),
        (Quantity::Yaw, Use::Optional),
        (Quantity::QuaternionW, Use::Optional),
        (Quantity::QuaternionX, Use::Optional),
        (Quantity::QuaternionY, Use::Optional),
        (Quantity::QuaternionZ, Use::Optional),
        (Quantity::Latitude, Use::Optional),
        (Quantity::Longitude, Use::Optional),
    ],
    is_unique: true,
    help: "the columns are time, x, y, z (or lat, lon, height) and roll, pitch, yaw (or qx, qy, qz, qw)",
};

const QUATERNION: [Quantity; 4] =
    [Quantity::QuaternionW, Quantity::QuaternionX, Quantity::QuaternionY, Quantity::QuaternionZ];

impl PoseColumn {
    fn quantity(self) -> Quantity {
        match self {
            PoseColumn::Time => Quantity::Time,
            PoseColumn::Roll => Quantity::Roll,
            PoseColumn::Pitch => Quantity::Pitch,
            PoseColumn::Yaw => Quantity::Yaw,
            PoseColumn::X => Quantity::X,
            PoseColumn::Y => Quantity::Y,
            PoseColumn::Z => Quantity::Z,
        }
    }

    fn is_angle(self) -> bool {
        self.quantity().dimension() == Dimension::Angle
    }
}

/// The columns of the attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum AttitudeColumns {
    /// Roll, pitch and yaw of [`PoseLayout::columns`].
    Angles,
    /// w, x, y, z.
    Quaternion([usize; 4]),
    /// The rotation of a matrix, row by row.
    Matrix([usize; 9]),
}

/// The columns of a table of poses, each array in the order of [`POSE_COLUMNS`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PoseLayout {
    pub columns: [Option<usize>; 7],
    /// Factors to seconds, metres and radians where the headings state units.
    pub factors: [Option<f64>; 7],
    /// X is the longitude, Y the latitude.
    pub geographic: bool,
    pub attitude: AttitudeColumns,
    /// Number of columns of every line, and where the number is from.
    pub width: Option<(usize, &'static str)>,
    /// True for the headings of EuRoC and of exported ROS topics, whose times are nanoseconds.
    pub has_ros_names: bool,
    unread: Unread,
}

/// Headings of columns that are not read.
#[derive(Clone, Debug, Default, PartialEq)]
struct Unread {
    /// Columns with unknown names, with suggestions.
    unknown: Vec<String>,
    help: Option<String>,
    /// Columns of quantities that are common in trajectories and unused here.
    ignored: Vec<String>,
}

/// The numbers of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PoseNumbers {
    /// Not converted, in the order of [`POSE_COLUMNS`]. Components without a column are 0.
    pub values: [f64; 7],
    /// Rotation from the body to the world in the axes of the file, of quaternions and matrices.
    pub rotation: Option<Rotation>,
}

impl PoseLayout {
    fn empty() -> PoseLayout {
        PoseLayout {
            columns: [None; 7],
            factors: [None; 7],
            geographic: false,
            attitude: AttitudeColumns::Angles,
            width: None,
            has_ros_names: false,
            unread: Unread::default(),
        }
    }

    /// Columns by number, in the order of [`POSE_COLUMNS`].
    pub fn numbered(columns: [usize; 7]) -> PoseLayout {
        PoseLayout { columns: columns.map(Some), ..PoseLayout::empty() }
    }

    /// Columns in the order of `order`. If `time` is given, it is the index of the time column, and the
    /// others skip it.
    pub fn in_order(order: &[PoseColumn], time: Option<usize>) -> PoseLayout {
        let mut layout = PoseLayout::empty();
        let places = (0..).filter(|place| Some(*place) != time);
        let others = order.iter().filter(|c| time.is_none() || **c != PoseColumn::Time);
        for (column, place) in others.zip(places) {
            layout.columns[*column as usize] = Some(place);
        }
        layout.set_time(time);
        layout
    }

    /// Time, position and a quaternion with w last, as SLAM programs write them.
    pub fn tum() -> PoseLayout {
        use PoseColumn::{Time, X, Y, Z};
        let attitude = AttitudeColumns::Quaternion([7, 4, 5, 6]);
        PoseLayout { attitude, ..PoseLayout::in_order(&[Time, X, Y, Z], None) }
    }

    /// A matrix of `rows` rows and four columns from column `first`, after the time if there is one; a fourth
    /// row is not read.
    pub fn matrix(first: usize, rows: usize) -> PoseLayout {
        let mut layout = PoseLayout::empty();
        for (column, place) in [(PoseColumn::X, 3), (PoseColumn::Y, 7), (PoseColumn::Z, 11)] {
            layout.columns[column as usize] = Some(first + place);
        }
        layout.set_time((first > 0).then_some(0));
        let rotation = [0, 1, 2, 4, 5, 6, 8, 9, 10].map(|place| first + place);
        let width = Some((first + 4 * rows, "the first line"));
        PoseLayout { attitude: AttitudeColumns::Matrix(rotation), width, ..layout }
    }

    pub fn set_time(&mut self, time: Option<usize>) {
        if time.is_some() {
            self.columns[PoseColumn::Time as usize] = time;
        }
    }

    /// The layout that headings describe.
    pub fn from_headings(
        names: impl IntoIterator<Item = impl AsRef<str>>,
    ) -> Result<PoseLayout, PoseLayoutError> {
        let names = join_units(names);
        let mut layout = PoseLayout::of(Headings::of(&names, &SCHEMA))?;
        layout.width = Some((names.len(), "the heading"));
        layout.has_ros_names =
            names.iter().any(|name| name.starts_with("field.") || plain(split_unit(name).0) == "prsrx");
        Ok(layout)
    }

    /// The layout of an Arrow stream; other columns than those of poses need not be numbers.
    pub fn from_fields(fields: &[TableField]) -> Result<PoseLayout, PoseLayoutError> {
        let headings = Headings::of(fields.iter().map(|field| &field.heading), &SCHEMA);
        let read = headings.columns.iter().map(|column| &fields[column.index]);
        if let Some(field) = read.into_iter().find(|field| !field.is_number()) {
            return Err(PoseLayoutError::NotNumbers { column: field.heading.clone(), holds: field.holds });
        }
        PoseLayout::of(headings)
    }

    /// The layout of headings, which may repeat a height next to both projected and geographic coordinates.
    /// Projected coordinates take precedence over latitude and longitude, and quaternions over angles.
    fn of(mut headings: Headings) -> Result<PoseLayout, PoseLayoutError> {
        if let Some(wrong) = headings.wrong_units.first() {
            return Err(PoseLayoutError::Unit { what: wrong.clone() });
        }
        let has = |quantity| headings.has(quantity);
        let is_projected = has(Quantity::X) && has(Quantity::Y);
        let is_geographic = has(Quantity::Longitude) && has(Quantity::Latitude);
        for (name, earlier) in std::mem::take(&mut headings.repeated) {
            if !(is_projected && is_geographic && name.eq_ignore_ascii_case(&earlier)) {
                return Err(PoseLayoutError::Duplicate { earlier, name });
            }
            headings.unused.push(name);
        }
        let mut unread = Unread {
            help: headings.suggestion(&SCHEMA),
            unknown: std::mem::take(&mut headings.unknown),
            ignored: std::mem::take(&mut headings.unused),
        };
        let name_of = |quantity| headings.get(quantity).map(|column| column.name.clone());
        let geographic = is_geographic && !is_projected;
        let others =
            if geographic { [Quantity::X, Quantity::Y] } else { [Quantity::Longitude, Quantity::Latitude] };
        unread.ignored.extend(others.into_iter().filter_map(name_of));
        let quaternion = QUATERNION.map(|quantity| headings.get(quantity).map(|column| column.index));
        let attitude = match quaternion {
            [None, None, None, None] => AttitudeColumns::Angles,
            [Some(w), Some(x), Some(y), Some(z)] => AttitudeColumns::Quaternion([w, x, y, z]),
            _ => {
                let missing = QUATERNION.iter().zip(quaternion).filter(|(_, column)| column.is_none());
                let quantities = missing.map(|(quantity, _)| quantity.name()).collect();
                return Err(PoseLayoutError::Missing { quantities, suggestion: None });
            }
        };
        let mut layout = PoseLayout { geographic, attitude, ..PoseLayout::empty() };
        for column in POSE_COLUMNS {
            let quantity = match column {
                PoseColumn::X if geographic => Quantity::Longitude,
                PoseColumn::Y if geographic => Quantity::Latitude,
                column => column.quantity(),
            };
            let Some(found) = headings.get(quantity) else { continue };
            if column.is_angle() && attitude != AttitudeColumns::Angles {
                unread.unknown.push(found.name.clone());
                continue;
            }
            layout.columns[column as usize] = Some(found.index);
            layout.factors[column as usize] = found.factor;
        }
        Ok(PoseLayout { unread, ..layout })
    }

    /// The layout that a user chooses: headings in their order, where unknown names skip a column, or
    /// `heading=number` with numbers from 1.
    pub fn chosen(columns: &[String]) -> Result<PoseLayout, PoseLayoutError> {
        let mut headings = Headings::default();
        let numbered = columns.iter().any(|column| column.contains('='));
        for (i, column) in columns.iter().enumerate() {
            let (name, number) = match column.rsplit_once('=') {
                Some((name, number)) => (name, number.trim().parse().unwrap_or(0)),
                None if numbered => return Err(PoseLayoutError::NoNumber { column: column.clone() }),
                None => (column.as_str(), i + 1),
            };
            if !(1..=MAX_COLUMNS).contains(&number) {
                return Err(PoseLayoutError::Number { column: column.clone() });
            }
            headings.add(number - 1, name.trim(), &SCHEMA);
            let is_unknown = headings.unknown.pop().is_some() | headings.unused.pop().is_some();
            if is_unknown && numbered {
                return Err(PoseLayoutError::Unknown { name: name.to_owned() });
            }
        }
        if let Some((name, earlier)) = headings.repeated.first() {
            let (earlier, name) = (earlier.clone(), name.clone());
            return Err(PoseLayoutError::DuplicateChoice { earlier, name });
        }
        for (i, later) in headings.columns.iter().enumerate() {
            if let Some(one) = headings.columns[..i].iter().find(|one| one.index == later.index) {
                let (one, other) = (one.quantity.name(), later.quantity.name());
                return Err(PoseLayoutError::SameColumn { one, other, column: later.index + 1 });
            }
        }
        let layout = PoseLayout::of(headings)?;
        if let Some(name) = layout.unread.unknown.iter().chain(&layout.unread.ignored).next() {
            return Err(PoseLayoutError::Unread { name: name.clone() });
        }
        Ok(layout)
    }

    /// The first quantity that `named` has in another column: its name, its column here and there.
    pub fn difference(&self, named: &PoseLayout) -> Option<(&'static str, usize, usize)> {
        let pairs = POSE_COLUMNS.iter().filter_map(|&c| {
            let (here, there) = (self.columns[c as usize]?, named.columns[c as usize]?);
            (here != there).then(|| (named.name_of(c), here, there))
        });
        pairs.into_iter().next()
    }

    fn name_of(&self, column: PoseColumn) -> &'static str {
        match column {
            PoseColumn::X if self.geographic => Quantity::Longitude.name(),
            PoseColumn::Y if self.geographic => Quantity::Latitude.name(),
            column => column.quantity().name(),
        }
    }

    pub fn complete(self, required: &[PoseColumn]) -> Result<PoseLayout, PoseLayoutError> {
        let has_angles = self.attitude == AttitudeColumns::Angles;
        let is_missing =
            |c: &&PoseColumn| self.columns[**c as usize].is_none() && (has_angles || !c.is_angle());
        let quantities: Vec<&'static str> =
            required.iter().filter(is_missing).map(|c| c.quantity().name()).collect();
        if quantities.is_empty() {
            return Ok(self);
        }
        Err(PoseLayoutError::Missing { quantities, suggestion: self.unread.help })
    }

    /// Warns of columns with unknown names, and lists others that are not read.
    pub fn report_unread(&self, place: Option<Place>, found: &mut Diagnostics) {
        let listed = |names: &[String]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
        let Unread { unknown, help, ignored } = &self.unread;
        if !unknown.is_empty() {
            let message = format!("columns that are not read: {}", listed(unknown));
            let help = help.clone().unwrap_or_else(|| SCHEMA.help.to_owned());
            found.warn(place.clone(), message).help(help);
        }
        if !ignored.is_empty() {
            found.note(place, format!("columns that are not used: {}", listed(ignored)));
        }
    }

    /// The layout of lines of `width` columns without names; columns beyond those of the layout give a
    /// warning.
    pub fn with_width(mut self, width: usize, place: Option<Place>, found: &mut Diagnostics) -> PoseLayout {
        let attitude: &[usize] = match &self.attitude {
            AttitudeColumns::Angles => &[],
            AttitudeColumns::Quaternion(columns) => columns,
            AttitudeColumns::Matrix(columns) => columns,
        };
        let last = self.columns.iter().flatten().chain(attitude).max().copied().unwrap_or_default();
        if last + 1 < width && self.width.is_none() {
            let columns = match width - last {
                2 => format!("column {width} has no name and is"),
                _ => format!("columns {} to {width} have no names and are", last + 2),
            };
            found.warn(place, format!("{columns} not read"));
        }
        self.width = Some((width, "the first line"));
        self
    }

    /// The numbers of a row.
    pub fn read(&self, row: &Row) -> Result<PoseNumbers, RowError> {
        if let Some((width, whose)) = self.width {
            row.check_width(width, whose)?;
        }
        let mut values = [0.0; 7];
        for column in POSE_COLUMNS {
            let Some(index) = self.columns[column as usize] else { continue };
            let name = self.name_of(column);
            let number = number_of(row, index, name)?;
            if column.is_angle() && !quantity::ATTITUDE.contains(number) {
                let (found, expected) = (quantity::number(number), quantity::ATTITUDE.expected);
                return Err(row.error(Some(index), format!("{name} is {found}, expected {expected}")));
            }
            values[column as usize] = number;
        }
        let rotation = match &self.attitude {
            AttitudeColumns::Angles => None,
            AttitudeColumns::Quaternion(columns) => {
                let mut numbers = [0.0; 4];
                for ((number, quantity), column) in numbers.iter_mut().zip(QUATERNION).zip(columns) {
                    *number = number_of(row, *column, quantity.name())?;
                }
                let rotation = of_quaternion(numbers);
                Some(rotation.map_err(|e| row.error(columns.iter().min().copied(), e.to_string()))?)
            }
            AttitudeColumns::Matrix(columns) => {
                let mut numbers = [0.0; 9];
                for (number, column) in numbers.iter_mut().zip(columns) {
                    *number = number_of(row, *column, "the matrix")?;
                }
                Some(of_matrix(numbers).ok_or_else(|| row.error(None, MATRIX_HELP))?)
            }
        };
        Ok(PoseNumbers { values, rotation })
    }

    /// Converts `values` to seconds, metres and radians. Angles without a unit are degrees if `degrees` is
    /// set.
    pub fn in_si(&self, mut values: [f64; 7], degrees: bool) -> [f64; 7] {
        for column in POSE_COLUMNS {
            let is_angle =
                column.is_angle() || self.geographic && matches!(column, PoseColumn::X | PoseColumn::Y);
            let value = &mut values[column as usize];
            match self.factors[column as usize] {
                Some(factor) => *value *= factor,
                None if degrees && is_angle => *value = radians(*value),
                None => {}
            }
        }
        values
    }
}

fn number_of(row: &Row, column: usize, name: &str) -> Result<f64, RowError> {
    let number = row.number(column, name)?;
    if number.is_finite() { Ok(number) } else { Err(row.expected_number(column, name)) }
}

#[cfg(test)]
mod tests;
