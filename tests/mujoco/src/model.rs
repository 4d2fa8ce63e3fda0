//! Models: MJCF text, compiled by MuJoCo.

use std::ffi::{CStr, CString, c_char, c_int};
use std::io::Write;
use std::ptr::{self, NonNull};

use thiserror::Error;

use crate::{Data, sys};

/// A compiled model (`mjModel`).
pub struct Model(NonNull<sys::mjModel>);

/// Why a model could not be made ready.
#[derive(Debug, Error)]
pub enum LoadsError {
    /// The temporary file that MuJoCo reads the text from could not be written.
    #[error("cannot write the model to a temporary file")]
    File(#[from] std::io::Error),
    /// MuJoCo refused the model; its own message.
    #[error("{0}")]
    Refused(String),
    /// The library that was loaded is not the one whose header this crate was compiled with.
    #[error("the library is MuJoCo {library}, but its header is of version {header}")]
    Version {
        /// The library's version, as `mj_version` gives it.
        library: i64,
        /// The header's version, `mjVERSION_HEADER`.
        header: i64,
    },
    /// No memory for the model's data.
    #[error("no memory for the model's data")]
    Memory,
}

/// The model has no body of this name.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("the model has no body `{0}`")]
pub struct UnknownBody(pub String);

impl Model {
    /// Compiles MJCF text.
    ///
    /// # Errors
    /// [`LoadsError`] when MuJoCo refuses the text, the text cannot be handed to it, or the library
    /// is not of the header's version.
    pub fn from_xml(text: &str) -> Result<Self, LoadsError> {
        // SAFETY: no arguments, no state.
        let library = i64::from(unsafe { sys::mj_version() });
        let header = i64::from(sys::mjVERSION_HEADER);
        if library != header {
            return Err(LoadsError::Version { library, header });
        }
        // MuJoCo reads files in every version; how it reads from memory differs between them.
        let mut file = tempfile::Builder::new().suffix(".xml").tempfile()?;
        file.write_all(text.as_bytes())?;
        let path = CString::new(file.path().as_os_str().as_encoded_bytes())
            .map_err(std::io::Error::from)?;
        let mut message: [c_char; 1000] = [0; 1000];
        // SAFETY: the path ends in NUL, no virtual file system is given, and MuJoCo writes a string
        // to the buffer of the given size.
        let model = unsafe {
            let size = message.len() as c_int;
            sys::mj_loadXML(path.as_ptr(), ptr::null(), message.as_mut_ptr(), size)
        };
        NonNull::new(model).map(Self).ok_or_else(|| {
            // SAFETY: the buffer was zeroed, and MuJoCo ends its message with NUL.
            let message = unsafe { CStr::from_ptr(message.as_ptr()) };
            LoadsError::Refused(message.to_string_lossy().trim_end().to_owned())
        })
    }

    /// A state of this model: at its reference configuration, at rest, without controls.
    ///
    /// # Errors
    /// [`LoadsError::Memory`] when there is none left.
    pub fn data(&self) -> Result<Data<'_>, LoadsError> {
        Data::new(self)
    }

    /// The body of a name, as an index into MuJoCo's arrays of bodies.
    pub(crate) fn body(&self, name: &str) -> Result<usize, UnknownBody> {
        let unknown = || UnknownBody(name.to_owned());
        let text = CString::new(name).map_err(|_| unknown())?;
        let kind = sys::mjOBJ_BODY as c_int;
        // SAFETY: the model is alive, and the name ends in NUL.
        let index = unsafe { sys::mj_name2id(self.as_ptr(), kind, text.as_ptr()) };
        usize::try_from(index).map_err(|_| unknown())
    }

    /// For MuJoCo's functions.
    pub(crate) fn as_ptr(&self) -> *const sys::mjModel {
        self.0.as_ptr()
    }

    /// The sizes and arrays of the model.
    pub(crate) fn fields(&self) -> &sys::mjModel {
        // SAFETY: MuJoCo made the model, it lives as long as `self`, and nothing changes it.
        unsafe { self.0.as_ref() }
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: the model is ours, and every `Data` that borrowed it is gone.
        unsafe { sys::mj_deleteModel(self.0.as_ptr()) }
    }
}
