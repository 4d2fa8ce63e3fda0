//! Where a field of a file belongs that stands in a table that has none of its name.
//!
//! Which fields a table has is asked of the type that it is read into: serde hands its fields to whatever reads it.

use serde::Deserialize;
use serde::de::{Deserializer, Error as _, Visitor, value::Error};
use serde::forward_to_deserialize_any;

/// A table of a file, and the fields that it may have.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Its name as a file has it, e.g. `[[modules]]`.
    pub name: &'static str,
    /// Its fields.
    pub fields: &'static [&'static str],
}

impl Table {
    /// The table `name`, which is read into a `T`; without fields where that is no struct.
    pub fn of<T: for<'de> Deserialize<'de>>(name: &'static str) -> Self {
        let mut fields: &'static [&'static str] = &[];
        // Whatever the type, nothing is made of it.
        drop(T::deserialize(Fields(&mut fields)));
        Self { name, fields }
    }
}

/// What an error's message that refuses a field should say besides: which of the file's tables have one of that name. Nothing where
/// it refuses something else, or none has.
fn misplaced(message: &str, tables: &[Table]) -> Option<String> {
    let (_, rest) = message.split_once("unknown field `")?;
    let (field, _) = rest.split_once('`')?;
    let names = tables.iter().filter(|table| table.fields.contains(&field));
    let names: Vec<&str> = names.map(|table| table.name).collect();
    match names[..] {
        [] => None,
        [ref before @ .., last] => {
            let list = match before.is_empty() {
                true => last.to_owned(),
                false => format!("{} or {last}", before.join(", ")),
            };
            Some(format!("`{field}` belongs in {list}"))
        }
    }
}

/// The message of an error that refuses a field, with what `misplaced` says besides.
pub fn with_place(message: &str, tables: &[Table]) -> String {
    match misplaced(message, tables) {
        Some(place) => format!("{}; {place}", message.trim_end()),
        None => message.to_owned(),
    }
}

/// Takes down the fields of the struct that is read from it.
struct Fields<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for Fields<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("no struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        *self.0 = fields;
        self.deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Deserialize)]
    #[allow(dead_code, reason = "only its fields are asked for")]
    struct Inner {
        radius: f64,
        #[serde(rename = "mass")]
        heavy: f64,
    }

    #[derive(Deserialize)]
    #[allow(dead_code, reason = "only its fields are asked for")]
    struct Outer {
        name: String,
        mass: f64,
    }

    #[test]
    fn a_field_is_sent_to_the_tables_that_have_it() {
        let tables = [
            Table::of::<Outer>("the file"),
            Table::of::<Inner>("[[inner]]"),
        ];
        assert_eq!(tables[1].fields, ["radius", "mass"]);
        assert!(Table::of::<f64>("a number").fields.is_empty());
        let said = |message: &str| misplaced(message, &tables);
        let refused = "line 3\nunknown field `radius`, expected one of `name`, `mass`";
        assert_eq!(
            said(refused).as_deref(),
            Some("`radius` belongs in [[inner]]")
        );
        assert_eq!(
            said("unknown field `mass`, expected nothing").as_deref(),
            Some("`mass` belongs in the file or [[inner]]")
        );
        assert_eq!(said("unknown field `radios`, expected `radius`"), None);
        assert_eq!(said("missing field `radius`"), None);
        assert!(with_place(refused, &tables).ends_with("`mass`; `radius` belongs in [[inner]]"));
        assert_eq!(with_place("missing", &tables), "missing");
    }
}
