//! The table as Parquet.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::{ParquetError, Result};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use tdcr_base::files::AtomicFile;

use super::table::Table;
use crate::study::error::StudyError;
use crate::study::spec::{Column, Kind};

/// Rows of a row group, which is held in memory.
const GROUP: usize = 65536;

/// Writes the table, in row groups of [`GROUP`] rows; empty cells are null.
pub(in crate::study) fn write(path: &Path, table: &Table) -> std::result::Result<(), StudyError> {
    let wrong = |source| StudyError::Parquet {
        path: path.to_owned(),
        source,
    };
    let fail = |source| StudyError::Write {
        path: path.to_owned(),
        source,
    };
    let mut file = AtomicFile::create(path).map_err(fail)?;
    let schema = schema(table.columns).map_err(wrong)?;
    let properties = Arc::new(WriterProperties::builder().build());
    let writer = SerializedFileWriter::new(&mut file, Arc::new(schema), properties);
    let mut writer = writer.map_err(wrong)?;
    let mut rows: Vec<Vec<String>> = Vec::new();
    table.rows(|_, cells| {
        rows.push(cells);
        if rows.len() == GROUP {
            add_group(&mut writer, table.columns, &rows).map_err(wrong)?;
            rows.clear();
        }
        Ok(())
    })?;
    if !rows.is_empty() {
        add_group(&mut writer, table.columns, &rows).map_err(wrong)?;
    }
    writer.close().map_err(wrong)?;
    file.commit().map_err(fail)
}

fn schema(columns: &[Column]) -> Result<Type> {
    let field = |column: &Column| {
        let title = column.title();
        let field = |physical| {
            Type::primitive_type_builder(&title, physical).with_repetition(Repetition::OPTIONAL)
        };
        let field = match column.kind {
            Kind::Number => field(Physical::DOUBLE),
            Kind::Whole => field(Physical::INT64),
            Kind::Text => field(Physical::BYTE_ARRAY).with_logical_type(Some(LogicalType::String)),
        };
        field.build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>>>()?;
    Type::group_type_builder("study")
        .with_fields(fields)
        .build()
}

fn add_group<W: std::io::Write + Send>(
    writer: &mut SerializedFileWriter<W>,
    columns: &[Column],
    rows: &[Vec<String>],
) -> Result<()> {
    let mut group = writer.next_row_group()?;
    for (place, column) in columns.iter().enumerate() {
        let Some(mut out) = group.next_column()? else {
            return Err(ParquetError::General(
                "the schema has too few columns".to_owned(),
            ));
        };
        let cells = || rows.iter().map(|row| row[place].as_str());
        // 0 where a cell is empty; the values are those of the others.
        let there: Vec<i16> = cells().map(|cell| i16::from(!cell.is_empty())).collect();
        let cells = cells().filter(|cell| !cell.is_empty());
        match column.kind {
            Kind::Number => {
                let values = numbers::<f64>(cells)?;
                out.typed::<DoubleType>()
                    .write_batch(&values, Some(&there), None)?;
            }
            Kind::Whole => {
                let values = numbers::<i64>(cells)?;
                out.typed::<Int64Type>()
                    .write_batch(&values, Some(&there), None)?;
            }
            Kind::Text => {
                let values: Vec<ByteArray> = cells.map(ByteArray::from).collect();
                out.typed::<ByteArrayType>()
                    .write_batch(&values, Some(&there), None)?;
            }
        }
        out.close()?;
    }
    group.close().map(drop)
}

fn numbers<'a, T: std::str::FromStr>(cells: impl Iterator<Item = &'a str>) -> Result<Vec<T>> {
    let number = |cell: &str| {
        (cell.parse()).map_err(|_| ParquetError::General(format!("`{cell}` is not a number")))
    };
    cells.map(number).collect()
}
