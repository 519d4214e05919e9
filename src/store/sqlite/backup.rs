//! All rows out, and in again.

use async_trait::async_trait;
use sqlx::AssertSqlSafe;

use super::SqliteStore;
use crate::store::backup::{self, Backup, Kind, Saved, Table, Take, backup_of};
use crate::store::{Row, StoreError};

backup_of!(SqliteStore, Sqlite);
