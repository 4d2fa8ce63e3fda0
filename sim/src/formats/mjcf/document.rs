//! An MJCF text as elements, its includes resolved.

use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_TEXT, read_text};

use crate::formats::{ImportError, Place, xml};

/// Deepest nesting of files that include one another.
const MAX_INCLUDE_DEPTH: usize = 32;
/// How deep elements may nest in a file. Robots have 1000 discs at the most; each may have bodies of
/// its own between.
const DEEPEST: usize = 8_000;

/// The elements of a model, and the files they come from. Held flat: a nested tree would take its
/// depth in stack to drop, and files may nest as deep as they like.
#[derive(Default)]
pub(super) struct Document {
    pub elements: Vec<Element>,
    files: Vec<Option<PathBuf>>,
    /// Length of all files read (bytes).
    length: u64,
}

/// One element.
pub(super) struct Element {
    pub tag: String,
    /// Names and values.
    pub attributes: Vec<(String, String)>,
    /// Indices of the elements within it.
    pub children: Vec<usize>,
    file: usize,
    line: u32,
}

impl Document {
    /// Reads a file and those it includes.
    pub fn read(path: &Path) -> Result<Self, ImportError> {
        let mut document = Self::default();
        let text = document.read_text(path)?;
        document.add_file(&text, Some(path), None, 0)?;
        document.merge_worldbodies();
        Ok(document)
    }

    /// Reads a text, which must include no files.
    pub fn parse(text: &str) -> Result<Self, ImportError> {
        let mut document = Self::default();
        document.add_file(text, None, None, 0)?;
        document.merge_worldbodies();
        Ok(document)
    }

    /// The elements within `element`.
    pub fn children(&self, element: usize) -> impl Iterator<Item = (usize, &Element)> {
        let indices = self.elements[element].children.iter();
        indices.map(|&index| (index, &self.elements[index]))
    }

    /// The elements within all top-level sections `tag`: a model may have several of each.
    pub fn section<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = (usize, &'a Element)> {
        self.sections(tag)
            .flat_map(|(index, _)| self.children(index))
    }

    /// All top-level sections `tag`.
    pub fn sections<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = (usize, &'a Element)> {
        self.children(0)
            .filter(move |(_, element)| element.tag == tag)
    }

    pub fn place(&self, element: usize) -> Place {
        let Element {
            tag,
            attributes,
            file,
            line,
            ..
        } = &self.elements[element];
        let name = attributes.iter().find(|(key, _)| key == "name");
        Place {
            file: self.files[*file].clone(),
            line: Some(*line),
            element: match name {
                Some((_, name)) => format!("<{tag} name=\"{name}\">"),
                None => format!("<{tag}>"),
            },
        }
    }

    /// The error that `element` cannot be represented.
    pub fn refuse(&self, element: usize, reason: impl Into<String>) -> ImportError {
        ImportError::Unsupported {
            place: self.place(element),
            reason: reason.into(),
        }
    }

    /// There is one world, though files that include one another may each say some of it.
    fn merge_worldbodies(&mut self) {
        let worlds: Vec<usize> = self.sections("worldbody").map(|(index, _)| index).collect();
        for &further in worlds.iter().skip(1) {
            let bodies = std::mem::take(&mut self.elements[further].children);
            self.elements[worlds[0]].children.extend(bodies);
        }
    }

    /// Adds the elements of a text: all of them as the model, or those within its root to `parent`.
    fn add_file(
        &mut self,
        text: &str,
        path: Option<&Path>,
        parent: Option<usize>,
        depth: usize,
    ) -> Result<(), ImportError> {
        let syntax = |reason: String| ImportError::Syntax {
            what: path.map_or_else(|| "the text".to_owned(), |p| p.display().to_string()),
            format: "a MuJoCo model (MJCF)",
            reason,
        };
        let xml = xml::parse(text, DEEPEST).map_err(syntax)?;
        let root = xml.root_element();
        if parent.is_none() && root.tag_name().name() != "mujoco" {
            let found = root.tag_name().name();
            let reason = format!("its root is <{found}>; expected <mujoco>");
            return Err(syntax(reason));
        }
        let file = self.files.len();
        self.files.push(path.map(Path::to_owned));
        // Where each node's children go, by the node's number in the text.
        let mut places: Vec<Option<usize>> = Vec::new();
        let (mut line, mut counted) = (1, 0);
        for node in root.descendants().filter(roxmltree::Node::is_element) {
            let start = node.range().start;
            line += text[counted..start].matches('\n').count() as u32;
            counted = start;
            let above = node
                .parent()
                .and_then(|p| places.get(p.id().get_usize()).copied().flatten());
            let index = match parent {
                Some(parent) if node == root => parent,
                _ => {
                    self.elements.push(Element {
                        tag: node.tag_name().name().to_owned(),
                        attributes: (node.attributes())
                            .map(|a| (a.name().to_owned(), a.value().to_owned()))
                            .collect(),
                        children: Vec::new(),
                        file,
                        line,
                    });
                    self.elements.len() - 1
                }
            };
            let number = node.id().get_usize();
            places.resize(places.len().max(number + 1), None);
            places[number] = Some(index);
            if node == root {
                continue;
            }
            if node.tag_name().name() == "include" {
                self.include(index, above, depth)?;
            } else if let Some(above) = above {
                self.elements[above].children.push(index);
            }
        }
        Ok(())
    }

    /// Adds the elements of the file that the element `include` names to `parent`.
    fn include(
        &mut self,
        include: usize,
        parent: Option<usize>,
        depth: usize,
    ) -> Result<(), ImportError> {
        let attributes = &self.elements[include].attributes;
        let Some((_, name)) = attributes.iter().find(|(name, _)| name == "file") else {
            return Err(self.refuse(include, "expected an attribute `file`"));
        };
        // As MuJoCo has it, relative to the folder of the main file.
        let Some(main) = &self.files[0] else {
            let reason = "a text cannot include files: import the model by its path";
            return Err(self.refuse(include, reason));
        };
        let path = main.parent().unwrap_or(Path::new("")).join(name);
        if self.files.iter().flatten().any(|file| *file == path) || depth == MAX_INCLUDE_DEPTH {
            let reason = format!("{name} is included more than once; expected once at most");
            return Err(self.refuse(include, reason));
        }
        let text = self.read_text(&path)?;
        self.add_file(&text, Some(&path), parent, depth + 1)
    }

    /// The text of a file, which counts towards what all files of a model may hold.
    fn read_text(&mut self, path: &Path) -> Result<String, ImportError> {
        let left = LARGEST_TEXT - self.length;
        let text = read_text(path, left).map_err(|source| ImportError::Read {
            path: path.to_owned(),
            source,
        })?;
        self.length += text.len() as u64;
        Ok(text)
    }
}
