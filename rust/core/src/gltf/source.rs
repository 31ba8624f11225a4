//! Files of a glTF document: its buffers and images, read only from allowed locations.
//!
//! A document may come from anyone. Its files are read only from its own folder or below (no absolute path, no `..`, no other scheme).
//! Images larger than 16,384 pixels on a side are not decoded ([`decode`]).

use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

use base64::Engine;

use crate::foliage::Image;
use crate::textures::image::decode;

/// Limit of pixels of all images together.
const MOST_PIXELS: usize = 1 << 30;

/// A document's folder, the bytes of its buffers, and its decoded images.
pub struct Source {
    folder: Option<PathBuf>,
    buffers: Vec<Vec<u8>>,
    images: HashMap<usize, Image>,
}

impl Source {
    /// Reads all buffers. `folder` is the document's folder; without one, the document may not refer to files.
    ///
    /// # Errors
    /// Describes the first invalid buffer.
    pub fn of(document: &gltf::Document, mut blob: Option<Vec<u8>>, folder: Option<&Path>) -> Result<Self, String> {
        let mut source = Self { folder: folder.map(Path::to_owned), buffers: Vec::new(), images: HashMap::new() };
        for buffer in document.buffers() {
            let bytes = match buffer.source() {
                gltf::buffer::Source::Bin => blob.take().ok_or("the file has no binary chunk for its buffer")?,
                gltf::buffer::Source::Uri(uri) => source.read(uri)?,
            };
            if bytes.len() < buffer.length() {
                return Err(format!(
                    "buffer {} has {} bytes, but declares {}",
                    buffer.index(),
                    bytes.len(),
                    buffer.length()
                ));
            }
            source.buffers.push(bytes);
        }
        Ok(source)
    }

    /// Returns the bytes of a buffer.
    pub fn buffer(&self, index: usize) -> Option<&[u8]> {
        self.buffers.get(index).map(Vec::as_slice)
    }

    /// Returns the bytes of a buffer view.
    pub fn view(&self, view: &gltf::buffer::View) -> Result<&[u8], String> {
        let end = view.offset().checked_add(view.length());
        let bytes = self.buffer(view.buffer().index()).zip(end).and_then(|(b, end)| b.get(view.offset()..end));
        bytes.ok_or_else(|| {
            let (from, length, buffer) = (view.offset(), view.length(), view.buffer().index());
            format!("buffer view {} spans {length} bytes from {from} of buffer {buffer}, which has fewer", view.index())
        })
    }

    /// Returns an image as 8-bit RGBA; decodes it once.
    pub fn image(&mut self, image: &gltf::Image) -> Result<Image, String> {
        if let Some(known) = self.images.get(&image.index()) {
            return Ok(known.clone());
        }
        let encoded = match image.source() {
            gltf::image::Source::View { view, .. } => self.view(&view)?.to_vec(),
            gltf::image::Source::Uri { uri, .. } => self.read(uri)?,
        };
        let decoded = decode(&encoded).map_err(|reason| format!("image {}: {reason}", image.index()))?;
        self.images.insert(image.index(), decoded.clone());
        let pixels: usize = self.images.values().map(|image| image.pixels().len()).sum();
        if pixels > MOST_PIXELS {
            return Err(format!("the images have {pixels} pixels in total; the limit is {MOST_PIXELS}"));
        }
        Ok(decoded)
    }

    fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            let (_, encoded) = data.split_once(";base64,").ok_or("a data URI that is not base64")?;
            return base64::engine::general_purpose::STANDARD.decode(encoded).map_err(|e| format!("a data URI: {e}"));
        }
        let path = self.inside(uri)?;
        read_file(&path).map_err(|reason| format!("{}: {reason}", path.display()))
    }

    /// Returns the path of a file in the document's folder; refuses any other location.
    fn inside(&self, uri: &str) -> Result<PathBuf, String> {
        let decoded = urlencoding::decode(uri).map_err(|_| format!("the URI {uri:?} is not UTF-8"))?;
        let path = Path::new(decoded.as_ref());
        // On Windows a backslash separates folders and a colon follows a drive; a colon may also follow a scheme. A relative URI has
        // neither.
        let plain = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        if !plain || decoded.contains(['\\', ':', '\0']) || decoded.is_empty() {
            return Err(format!(
                "the URI {uri:?} leads out of the document's folder; put the file beside the document"
            ));
        }
        match &self.folder {
            Some(folder) => {
                let path = folder.join(path);
                // A link inside the folder may also lead out of it. Missing files are reported when they are read.
                let real = path.canonicalize().ok().zip(folder.canonicalize().ok());
                if real.is_some_and(|(path, folder)| !path.starts_with(folder)) {
                    return Err(format!(
                        "the URI {uri:?} is a link that leads out of the document's folder; put the file itself there"
                    ));
                }
                Ok(path)
            }
            None => Err(format!("the URI {uri:?} refers to a file, but the document has no folder")),
        }
    }
}

/// Reads a regular file. Refuses pipes and devices, which may be endless.
///
/// # Errors
/// The operating system's error, or that it is not a regular file.
pub fn read_file(path: &Path) -> Result<Vec<u8>, String> {
    let regular = std::fs::metadata(path).map_err(|e| e.to_string())?.is_file();
    if !regular {
        return Err("it is not a regular file".to_owned());
    }
    std::fs::read(path).map_err(|e| e.to_string())
}
