//! Columns of numbers of a file that is read by column.

/// Columns of numbers of a file, and the names of its other columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NumberTable {
    /// Names and values of the columns that are read, in the order of the file; NaN for nulls.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Names of the columns that are not read, in the order of the file.
    pub unread: Vec<String>,
}

impl NumberTable {
    /// Removes and returns the values of the first column with a name.
    pub fn take(&mut self, name: &str) -> Option<Vec<f64>> {
        let at = self.columns.iter().position(|(other, _)| other == name)?;
        Some(self.columns.remove(at).1)
    }

    /// Text about the columns that are not read; `None` if all are read.
    pub fn unread_message(&self) -> Option<String> {
        let columns = match self.unread.len() {
            0 => return None,
            1 => "column",
            _ => "columns",
        };
        let names: Vec<String> = self.unread.iter().map(|name| format!("`{name}`")).collect();
        Some(format!("{columns} {} not read", names.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_taken_by_name_and_others_are_named() {
        let mut table = NumberTable { columns: vec![("a".to_owned(), vec![1.0])], ..NumberTable::default() };
        assert_eq!(table.unread_message(), None);
        assert_eq!((table.take("b"), table.take("a"), table.take("a")), (None, Some(vec![1.0]), None));
        table.unread.push("c".to_owned());
        assert_eq!(table.unread_message().unwrap(), "column `c` not read");
        table.unread.push("d".to_owned());
        assert_eq!(table.unread_message().unwrap(), "columns `c`, `d` not read");
    }
}
