//! MAT files of level 5 (`save -v6`, `-v7`, `SciPy`, Octave): numeric arrays and structures, both byte orders.
//!
//! A file is a header of 128 bytes and a list of elements; an element is a type, a length and that many bytes.
//! Nothing in a file is trusted: every length is checked against the bytes that are there.
//! Source: the vendor's "MAT-File Format", chapter "Level 5 MAT-File Format".

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::{Array, Variable, indexed};

/// Bytes of the header; the last four are the version and the byte order.
const HEADER: usize = 128;
/// Most bytes that one compressed variable may hold: 1 GiB.
const MOST_INFLATED: u64 = 1 << 30;
/// Deepest nesting of structures.
const MOST_NESTED: u32 = 32;

/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Classes of arrays.
const CLASS_CELL: u8 = 1;
const CLASS_STRUCTURE: u8 = 2;
const CLASS_TEXT: u8 = 4;
const CLASS_NUMERIC: std::ops::RangeInclusive<u8> = 6..=15;
const CLASS_SINGLE: u8 = 7;
const CLASS_OPAQUE: u8 = 17;
const FLAG_COMPLEX: u8 = 0x08;

/// The variables of a file, in its order.
pub(super) struct Variables(Vec<(String, Node)>);

/// A variable, or a field of a structure.
enum Node {
    Leaf(Variable),
    /// A structure, or an array of them.
    Structures(Vec<Fields>),
}

/// The fields of a structure.
type Fields = Vec<(String, Node)>;

impl Variables {
    pub(super) fn decode(bytes: &[u8]) -> Result<Self, String> {
        let header = bytes.get(..HEADER).ok_or("the file is shorter than a MAT header")?;
        let big_endian = match &header[126..] {
            b"IM" => false,
            b"MI" => true,
            _ => {
                return Err("no MAT header of v5 to v7.3 (a v4 file has none: save it with `-v7`)".to_owned());
            }
        };
        let mut input = Input { bytes: &bytes[HEADER..], big_endian };
        let mut variables = Vec::new();
        while !input.bytes.is_empty() {
            let element = input.element()?;
            let found = if element.kind == COMPRESSED {
                let inflated = inflate(element.bytes)?;
                Input { bytes: &inflated, big_endian }.element()?.matrix(big_endian, 0)?
            } else {
                element.matrix(big_endian, 0)?
            };
            // MATLAB ends a file with nameless data of its own objects.
            variables.extend(found.filter(|(name, _)| !name.is_empty()));
        }
        Ok(Self(variables))
    }

    pub(super) fn paths(&self) -> Vec<String> {
        let mut paths = Vec::new();
        list(&self.0, "", &mut paths);
        paths
    }

    pub(super) fn find(&self, path: &str) -> Option<Variable> {
        let mut nodes = &self.0;
        let mut names = path.split('.').peekable();
        while let Some(name) = names.next() {
            let (name, element) = indexed(name);
            let (_, node) = nodes.iter().find(|(other, _)| other == name)?;
            let fields = match (node, element) {
                (Node::Leaf(variable), None) if names.peek().is_none() => return Some(variable.clone()),
                (Node::Leaf(_), _) => return None,
                (Node::Structures(all), Some(element)) => all.get(element)?,
                (Node::Structures(all), None) => match &all[..] {
                    [only] => only,
                    _ => return Some(Variable::Other(format!("an array of {} structures", all.len()))),
                },
            };
            nodes = fields;
        }
        Some(Variable::Other("a structure".to_owned()))
    }
}

fn list(nodes: &[(String, Node)], prefix: &str, paths: &mut Vec<String>) {
    for (name, node) in nodes {
        match node {
            Node::Leaf(_) => paths.push(format!("{prefix}{name}")),
            Node::Structures(all) => {
                for (index, fields) in all.iter().enumerate() {
                    let number = if all.len() == 1 { String::new() } else { format!("({})", index + 1) };
                    list(fields, &format!("{prefix}{name}{number}."), paths);
                }
            }
        }
    }
}

fn inflate(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut inflated = Vec::new();
    let mut decoder = ZlibDecoder::new(bytes).take(MOST_INFLATED);
    decoder.read_to_end(&mut inflated).map_err(|error| format!("damaged compressed data: {error}"))?;
    Ok(inflated)
}

/// Bytes that are still to be read.
struct Input<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

/// A type and the bytes that belong to it.
struct Element<'a> {
    kind: u32,
    bytes: &'a [u8],
}

impl<'a> Input<'a> {
    /// The next `length` bytes.
    fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        let (head, rest) = self.bytes.split_at_checked(length).ok_or("the file ends too early")?;
        self.bytes = rest;
        Ok(head)
    }

    fn word(&mut self) -> Result<u32, String> {
        Ok(words(self.take(4)?, self.big_endian).next().unwrap_or_default())
    }

    /// The next element, and past the padding that follows it.
    fn element(&mut self) -> Result<Element<'a>, String> {
        let word = self.word()?;
        let short_length = (word >> 16) as usize;
        if short_length > 0 {
            let data = self.take(4)?;
            let bytes = data.get(..short_length).ok_or("a short element of more than four bytes")?;
            return Ok(Element { kind: word & 0xffff, bytes });
        }
        let length = self.word()? as usize;
        let bytes = self.take(length)?;
        if word != COMPRESSED {
            let padding = length.wrapping_neg() % 8;
            self.take(padding.min(self.bytes.len()))?;
        }
        Ok(Element { kind: word, bytes })
    }
}

impl Element<'_> {
    /// Name and content of an array element; `None` where the element holds no array.
    fn matrix(&self, big_endian: bool, depth: u32) -> Result<Option<(String, Node)>, String> {
        if self.kind != MATRIX {
            return Ok(None);
        }
        let other = |what: &str| Node::Leaf(Variable::Other(what.to_owned()));
        if self.bytes.is_empty() {
            return Ok(Some((String::new(), other("an empty array"))));
        }
        let mut input = Input { bytes: self.bytes, big_endian };
        let flags = words(input.element()?.bytes, big_endian).next().ok_or("an array without flags")?;
        let [class, flags, ..] = flags.to_le_bytes();
        if class == CLASS_OPAQUE {
            return Ok(Some((text(input.element()?.bytes), other("an object"))));
        }
        let extents: Vec<usize> =
            words(input.element()?.bytes, big_endian).map(|extent| extent as usize).collect();
        let count = extents.iter().try_fold(1_usize, |product, &extent| product.checked_mul(extent));
        let name = text(input.element()?.bytes);
        let node = match class {
            CLASS_STRUCTURE => Node::Structures(input.structures(count.unwrap_or(usize::MAX), depth)?),
            CLASS_CELL => other("a cell array"),
            CLASS_TEXT => other("text"),
            class if !CLASS_NUMERIC.contains(&class) => other("a sparse array or other data"),
            _ if flags & FLAG_COMPLEX != 0 => other("complex numbers"),
            class => {
                let data = input.element()?;
                let values = numbers(data.kind, data.bytes, big_endian)
                    .ok_or_else(|| format!("`{name}` has numbers of the unknown type {}", data.kind))?;
                if count != Some(values.len()) {
                    return Err(format!("`{name}` does not have as many numbers as its extents say"));
                }
                Node::Leaf(Variable::Array(Array { extents, values, single: class == CLASS_SINGLE }))
            }
        };
        Ok(Some((name, node)))
    }
}

impl Input<'_> {
    /// So many structures: the length of a name, the names, one array for each name of each structure.
    fn structures(&mut self, count: usize, depth: u32) -> Result<Vec<Fields>, String> {
        if depth >= MOST_NESTED {
            return Err(format!("structures nested deeper than {MOST_NESTED}"));
        }
        let big_endian = self.big_endian;
        let width = words(self.element()?.bytes, big_endian).next().unwrap_or_default() as usize;
        let names = self.element()?.bytes;
        if width == 0 || names.len() < width {
            return Ok(vec![Vec::new()]);
        }
        let mut fields_of_one = || {
            let mut fields = Vec::new();
            for name in names.chunks_exact(width) {
                if let Some((_, node)) = self.element()?.matrix(big_endian, depth + 1)? {
                    fields.push((text(name), node));
                }
            }
            Ok(fields)
        };
        (0..count).map(|_| fields_of_one()).collect()
    }
}

fn words(bytes: &[u8], big_endian: bool) -> impl Iterator<Item = u32> {
    bytes
        .as_chunks()
        .0
        .iter()
        .map(move |&word| if big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) })
}

/// The characters before the first NUL.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// The numbers of a data element of type `kind`; `None` for a type that holds none.
fn numbers(kind: u32, bytes: &[u8], big_endian: bool) -> Option<Vec<f64>> {
    macro_rules! decode {
        ($number:ty) => {
            bytes.as_chunks().0.iter().map(|&raw| {
                if big_endian { <$number>::from_be_bytes(raw) } else { <$number>::from_le_bytes(raw) }
            })
        };
    }
    Some(match kind {
        1 => decode!(i8).map(f64::from).collect(),
        2 => decode!(u8).map(f64::from).collect(),
        3 => decode!(i16).map(f64::from).collect(),
        4 => decode!(u16).map(f64::from).collect(),
        5 => decode!(i32).map(f64::from).collect(),
        6 => decode!(u32).map(f64::from).collect(),
        7 => decode!(f32).map(f64::from).collect(),
        9 => decode!(f64).collect(),
        12 => decode!(i64).map(|value| value as f64).collect(),
        13 => decode!(u64).map(|value| value as f64).collect(),
        _ => return None,
    })
}
