//! MAT files of v7.3: HDF5 with datasets for arrays and groups for structures.

use hdf5_pure::{AttrValue, DType, Dataset, File, Group, Object};

use super::{Array, Variable, indexed};

/// Where the HDF5 part of a file may start: at once, or behind the header that MATLAB puts before it.
const STARTS: [usize; 2] = [0, 512];
const SIGNATURE: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Attribute with the class of an array.
const CLASS: &str = "MATLAB_class";
/// Attribute of an empty array, whose dataset holds its extents.
const EMPTY: &str = "MATLAB_empty";
/// Deepest nesting of groups that is listed.
const MOST_NESTED: u32 = 8;

/// Is this an HDF5 file?
pub(super) fn is_hdf5(bytes: &[u8]) -> bool {
    STARTS.iter().any(|&start| bytes.get(start..).is_some_and(|rest| rest.starts_with(SIGNATURE)))
}

/// The variables of a file.
pub(super) struct Variables {
    file: File,
}

impl Variables {
    pub(super) fn decode(bytes: &[u8]) -> Result<Self, String> {
        let file = File::from_bytes(bytes.to_vec()).map_err(|error| error.to_string())?;
        Ok(Self { file })
    }

    pub(super) fn paths(&self) -> Vec<String> {
        let mut paths = Vec::new();
        list(&self.file.root(), "", 0, &mut paths);
        paths
    }

    pub(super) fn find(&self, path: &str) -> Option<Result<Variable, String>> {
        let (mut object, mut element) = (Object::Group(self.file.root()), None);
        for name in path.split('.') {
            let Object::Group(group) = &object else { return None };
            let (name, next) = indexed(name);
            object = member(group, name, element)?;
            element = next;
        }
        match (object, element) {
            (Object::Dataset(dataset), None) => Some(read(&dataset)),
            (Object::Group(_), _) => Some(Ok(Variable::Other("a structure".to_owned()))),
            _ => None,
        }
    }
}

/// A field of a structure, or of one of an array of them, whose fields are references.
fn member(group: &Group, name: &str, element: Option<usize>) -> Option<Object> {
    match (group.dataset(name), element) {
        (Ok(field), Some(element)) if is_of_array(&field) => {
            field.dereference().ok()?.into_iter().nth(element)
        }
        (Ok(field), None | Some(0)) => Some(Object::Dataset(Box::new(field))),
        (Err(_), None | Some(0)) => group.group(name).ok().map(Object::Group),
        _ => None,
    }
}

/// Does it hold a field of each structure of an array?
fn is_of_array(dataset: &Dataset) -> bool {
    let has_class = dataset.attrs().is_ok_and(|attributes| attributes.contains_key(CLASS));
    !has_class && dataset.dtype().is_ok_and(|kind| matches!(kind, DType::ObjectReference))
}

fn read(dataset: &Dataset) -> Result<Variable, String> {
    let failed = |error: hdf5_pure::Error| error.to_string();
    let attributes = dataset.attrs().map_err(failed)?;
    let class = attributes.get(CLASS).and_then(text);
    let other = |what: &str| Ok(Variable::Other(what.to_owned()));
    if attributes.contains_key(EMPTY) {
        return other("an empty array");
    }
    match class {
        Some("cell") => return other("a cell array"),
        Some("char") => return other("text"),
        Some(class @ ("string" | "function_handle")) => return other(&format!("data of the class {class}")),
        _ => {}
    }
    let single = match dataset.dtype().map_err(failed)? {
        DType::F32 => true,
        DType::F64
        | DType::I8
        | DType::I16
        | DType::I32
        | DType::I64
        | DType::U8
        | DType::U16
        | DType::U32
        | DType::U64 => false,
        DType::Compound(_) => return other("complex numbers or a compound"),
        DType::ObjectReference => return other("a field of an array of structures"),
        _ => return other("data that are not numbers"),
    };
    // HDF5 counts extents from the slowest, MATLAB from the fastest.
    let shape = dataset.shape().map_err(failed)?;
    let extents: Vec<usize> =
        shape.iter().rev().map(|&extent| usize::try_from(extent).unwrap_or(usize::MAX)).collect();
    let values = dataset.read_f64().map_err(failed)?;
    Ok(Variable::Array(Array { extents, values, single }))
}

fn text(value: &AttrValue) -> Option<&str> {
    match value {
        AttrValue::String(text) | AttrValue::AsciiString(text) => Some(text.trim_end_matches('\0')),
        _ => None,
    }
}

/// Appends the paths of the datasets of a group, without those that MATLAB keeps for itself; of an array of structures, those
/// that are fields of each.
fn list(group: &Group, owner: &str, depth: u32, paths: &mut Vec<String>) {
    let own = |name: &String| !name.starts_with('#');
    let path =
        |owner: &str, name: &str| if owner.is_empty() { name.to_owned() } else { format!("{owner}.{name}") };
    for name in group.datasets().unwrap_or_default().into_iter().filter(own) {
        let field = group.dataset(&name).ok().filter(is_of_array);
        match field.and_then(|field| field.dereference().ok()) {
            None => paths.push(path(owner, &name)),
            Some(objects) => {
                let is_dataset = |(_, object): &(usize, Object)| matches!(object, Object::Dataset(_));
                let listed = objects.into_iter().enumerate().filter(is_dataset);
                paths.extend(listed.map(|(index, _)| path(&format!("{owner}({})", index + 1), &name)));
            }
        }
    }
    if depth == MOST_NESTED {
        return;
    }
    for name in group.groups().unwrap_or_default().into_iter().filter(own) {
        if let Ok(inner) = group.group(&name) {
            list(&inner, &path(owner, &name), depth + 1, paths);
        }
    }
}
