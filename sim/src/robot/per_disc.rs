//! One value for all discs of a module, or one for each.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// One value for all discs of a module, or one for each, from the lowest to the highest.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum PerDisc<T> {
    /// The same for every disc.
    Uniform(T),
    /// One value per disc.
    Each(Vec<T>),
}

impl<T> PerDisc<T> {
    /// The value of the module's disc `index`; `None` when the list is too short.
    pub fn of_disc(&self, index: usize) -> Option<&T> {
        match self {
            Self::Uniform(value) => Some(value),
            Self::Each(values) => values.get(index),
        }
    }

    /// Whether all values are so.
    pub(crate) fn all(&self, is_so: impl FnMut(&T) -> bool) -> bool {
        match self {
            Self::Uniform(value) => std::slice::from_ref(value).iter().all(is_so),
            Self::Each(values) => values.iter().all(is_so),
        }
    }

    /// Changes each value.
    pub(crate) fn change(&mut self, change: impl FnMut(&mut T)) {
        match self {
            Self::Uniform(value) => std::slice::from_mut(value).iter_mut().for_each(change),
            Self::Each(values) => values.iter_mut().for_each(change),
        }
    }
}

// A list holds one value per disc, anything else is the one value, so that an error within either
// names its field: an untagged enum would only say that neither fits.
impl<'de, T: Deserialize<'de>> Deserialize<'de> for PerDisc<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrList<T>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>> Visitor<'de> for OneOrList<T> {
            type Value = PerDisc<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("one value, or a list with one per disc")
            }

            fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<PerDisc<T>, E> {
                T::deserialize(value.into_deserializer()).map(PerDisc::Uniform)
            }

            fn visit_u64<E: serde::de::Error>(self, value: u64) -> Result<PerDisc<T>, E> {
                T::deserialize(value.into_deserializer()).map(PerDisc::Uniform)
            }

            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<PerDisc<T>, E> {
                T::deserialize(value.into_deserializer()).map(PerDisc::Uniform)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<PerDisc<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(PerDisc::Uniform)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<PerDisc<T>, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(PerDisc::Each)
            }
        }

        deserializer.deserialize_any(OneOrList(PhantomData))
    }
}
