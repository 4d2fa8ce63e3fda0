//! What a study leaves: its table on disk, and what is read off it.

pub(in crate::study) mod columns;
pub(in crate::study) mod dexterity;
pub(in crate::study) mod parquet_file;
pub(in crate::study) mod record;
pub(in crate::study) mod summary;
pub(in crate::study) mod table;
pub(in crate::study) mod thinned;
pub(in crate::study) mod tip_loop;
pub(in crate::study) mod workspace;
