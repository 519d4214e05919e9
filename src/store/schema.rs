//! Migrations as they lie under `migrations/`, compiled in.
//!
//! sqlx's `migrate!` does the same, at the price of building sqlx and both databases' drivers a second time for its macros.
//! What it writes into a database is what this writes: version, description and SHA-384 of a file.

use sqlx::SqlSafeStr;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// A migration of a folder: the number that its file begins with, the rest of its name, and its text.
pub(super) type File = (i64, &'static str, &'static str);

/// What brings a database up to date. One that a later version has brought further is taken as it is: while servers and
/// workers are replaced one after the other, those of the version before start again, too.
pub(super) fn migrator(files: &[File]) -> Migrator {
    let migration = |&(version, description, sql): &File| {
        Migration::new(version, description.into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    let mut migrator = Migrator::with_migrations(files.iter().map(migration).collect());
    migrator.set_ignore_missing(true);
    migrator
}

#[cfg(test)]
mod tests {
    use super::super::{postgres, sqlite};

    /// A file that nobody listed would be a schema that no database has.
    #[test]
    fn every_file_of_the_folders_is_listed() {
        for (folder, files) in [("sqlite", &sqlite::MIGRATIONS[..]), ("postgres", &postgres::MIGRATIONS[..])] {
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("migrations").join(folder);
            let mut names: Vec<_> =
                std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            let listed: Vec<_> =
                files.iter().map(|(v, what, _)| format!("{v:04}_{}.sql", what.replace(' ', "_"))).collect();
            assert_eq!(names, listed);
            for (name, (_, _, text)) in names.iter().zip(files) {
                assert_eq!(std::fs::read_to_string(path.join(name)).unwrap(), *text);
            }
        }
    }
}
