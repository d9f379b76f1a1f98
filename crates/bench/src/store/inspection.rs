//! What the history's file is, for whoever looks after the machine.

use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::health::StoreError;
use super::{FILE_NAME, schema};

/// What a history's file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inspection {
    /// Version of its tables; 0 where it has none yet.
    pub version: usize,
    /// The version that this program writes.
    pub newest: usize,
    /// Its size, bytes.
    pub bytes: u64,
}

/// Looks at the history in a folder and changes nothing of it; `None` where there is none.
///
/// # Errors
/// [`StoreError::Unusable`] where there is a file that cannot be read, or is no history.
pub fn inspect(folder: &Path) -> Result<Option<Inspection>, StoreError> {
    let file = folder.join(FILE_NAME);
    let bytes = match std::fs::metadata(&file) {
        Ok(found) => found.len(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(StoreError::Unusable(format!("{}: {error}", file.display()))),
    };
    let look = || {
        let connection = Connection::open_with_flags(&file, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let version = schema::version(&connection)?;
        // Reads the tables' definitions: what is damaged there says so.
        connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get::<_, i64>(0))?;
        Ok(Inspection { version, newest: schema::newest(), bytes })
    };
    look().map(Some).map_err(|error: StoreError| error.of(&file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_history_is_told_from_none_and_from_what_is_none() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(inspect(folder.path()), Ok(None));
        let file = folder.path().join(FILE_NAME);
        let mut connection = Connection::open(&file).unwrap();
        schema::bring_up_to_date(&mut connection).unwrap();
        let found = inspect(folder.path()).unwrap().unwrap();
        assert_eq!((found.version, found.newest), (schema::newest(), schema::newest()));
        assert!(found.bytes > 0);
        connection.pragma_update(None, "user_version", 99).unwrap();
        assert_eq!(inspect(folder.path()).unwrap().unwrap().version, 99);
        drop(connection);
        std::fs::write(&file, "no database, but long enough to have a header of a hundred bytes. ".repeat(4)).unwrap();
        let refused = inspect(folder.path()).unwrap_err().to_string();
        assert!(refused.contains(FILE_NAME), "{refused}");
    }
}
