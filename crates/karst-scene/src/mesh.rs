//! Triangle meshes from OBJ and STL files.

use crate::{Hit, MeshError, SceneError};
use karst_rig::Ray;
use nalgebra::{Point3, Vector3};
use std::path::Path;

/// Triangles with a bounding volume hierarchy. Both sides of a triangle are wall.
#[derive(Debug)]
pub struct Mesh {
    triangles: Vec<[Point3<f64>; 3]>,
    nodes: Vec<Node>,
}

#[derive(Debug)]
struct Node {
    min: Point3<f64>,
    max: Point3<f64>,
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// Range of triangles.
    Leaf(std::ops::Range<usize>),
    /// The first child follows its parent; this is the second.
    Inner(usize),
}

/// Triangles in a leaf.
const LEAF: usize = 4;

impl Mesh {
    /// Reads a `.obj` or `.stl` (binary or text) file. `mm_per_unit` is the file's unit of length: 1000 for metres.
    pub fn load(path: &Path, mm_per_unit: f64) -> Result<Self, SceneError> {
        if !(mm_per_unit.is_finite() && mm_per_unit > 0.0) {
            return Err(SceneError::Parameter { name: "mm_per_unit", value: mm_per_unit, expected: "positive" });
        }
        let bytes = std::fs::read(path).map_err(|source| SceneError::Read { path: path.into(), source })?;
        let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let triangles = match extension.as_deref() {
            Some("obj") => read_obj(&bytes),
            Some("stl") => read_stl(&bytes),
            _ => Err(MeshError::Format),
        };
        triangles
            .map(|t| t.into_iter().map(|t| t.map(|p| Point3::from(p.map(|c| f64::from(c) * mm_per_unit)))).collect())
            .and_then(Self::new)
            .map_err(|reason| SceneError::Mesh { path: path.into(), reason })
    }

    /// Mesh of triangles given by their corners, mm. Triangles without area are left out.
    pub fn new(triangles: Vec<[Point3<f64>; 3]>) -> Result<Self, MeshError> {
        if let Some(i) = triangles.iter().position(|t| t.iter().any(|p| p.coords.iter().any(|c| !c.is_finite()))) {
            return Err(MeshError::NotFinite(i));
        }
        let mut triangles: Vec<_> =
            triangles.into_iter().filter(|t| (t[1] - t[0]).cross(&(t[2] - t[0])).norm() > 0.0).collect();
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        let mut nodes = Vec::new();
        let count = triangles.len();
        build(&mut triangles, 0..count, &mut nodes);
        Ok(Self { triangles, nodes })
    }

    /// The triangles, mm, in no particular order.
    pub fn triangles(&self) -> &[[Point3<f64>; 3]] {
        &self.triangles
    }

    pub(crate) fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let mut best: Option<(f64, usize)> = None;
        let inverse = ray.direction.map(|d| 1.0 / d);
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index];
            if !node.is_met(ray, &inverse, best.map_or(f64::INFINITY, |b| b.0)) {
                continue;
            }
            match &node.content {
                Content::Inner(second) => stack.extend([*second, index + 1]),
                Content::Leaf(range) => {
                    for i in range.clone() {
                        if let Some(t) = meet_triangle(ray, &self.triangles[i])
                            && best.is_none_or(|b| t < b.0)
                        {
                            best = Some((t, i));
                        }
                    }
                }
            }
        }
        let (t, i) = best?;
        let [a, b, c] = self.triangles[i];
        let normal = (b - a).cross(&(c - a)).normalize();
        let normal = if normal.dot(&ray.direction) > 0.0 { -normal } else { normal };
        Some(Hit { point: ray.origin + t * ray.direction, normal, t_mm: t })
    }
}

impl Node {
    fn is_met(&self, ray: &Ray, inverse: &Vector3<f64>, limit: f64) -> bool {
        let (mut near, mut far) = (0f64, limit);
        for axis in 0..3 {
            let a = (self.min[axis] - ray.origin[axis]) * inverse[axis];
            let b = (self.max[axis] - ray.origin[axis]) * inverse[axis];
            // f64::max and min drop the NaN of a ray that runs in a face of the box.
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        // Rounding must not lose a ray that only touches the box.
        near <= far * (1.0 + 1e-12) + 1e-9
    }
}

/// Appends the hierarchy over a range of triangles, sorting them by place.
fn build(triangles: &mut [[Point3<f64>; 3]], range: std::ops::Range<usize>, nodes: &mut Vec<Node>) {
    let (mut min, mut max) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    for point in triangles[range.clone()].iter().flatten() {
        min = min.inf(point);
        max = max.sup(point);
    }
    let index = nodes.len();
    nodes.push(Node { min, max, content: Content::Leaf(range.clone()) });
    if range.len() <= LEAF {
        return;
    }
    let axis = (max - min).imax();
    let middle = range.start + range.len() / 2;
    let centre = |t: &[Point3<f64>; 3]| t[0][axis] + t[1][axis] + t[2][axis];
    triangles[range.clone()].select_nth_unstable_by(range.len() / 2, |a, b| centre(a).total_cmp(&centre(b)));
    build(triangles, range.start..middle, nodes);
    nodes[index].content = Content::Inner(nodes.len());
    build(triangles, middle..range.end, nodes);
}

/// Möller and Trumbore's test.
fn meet_triangle(ray: &Ray, [a, b, c]: &[Point3<f64>; 3]) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let p = ray.direction.cross(&e2);
    let determinant = e1.dot(&p);
    if determinant == 0.0 {
        return None;
    }
    let s = ray.origin - a;
    let u = s.dot(&p) / determinant;
    let q = s.cross(&e1);
    let v = ray.direction.dot(&q) / determinant;
    let t = e2.dot(&q) / determinant;
    // The tolerance closes the hairline between neighbours.
    (u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 && t > 1e-6).then_some(t)
}

type Triangles = Vec<[[f32; 3]; 3]>;

fn read_obj(bytes: &[u8]) -> Result<Triangles, MeshError> {
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Materials have no influence on the geometry: they are not looked for.
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &options, |_| Ok(Default::default()))
        .map_err(|e| MeshError::Obj(e.to_string()))?;
    let mut triangles = Vec::new();
    for model in &models {
        let (vertices, _) = model.mesh.positions.as_chunks::<3>();
        let (faces, _) = model.mesh.indices.as_chunks::<3>();
        for face in faces {
            match face.map(|i| vertices.get(i as usize).copied()) {
                [Some(a), Some(b), Some(c)] => triangles.push([a, b, c]),
                _ => return Err(MeshError::Obj("face refers to a missing vertex".into())),
            }
        }
    }
    Ok(triangles)
}

/// Bytes of a binary STL file before its first triangle, and per triangle.
const STL_HEADER: usize = 84;
const STL_TRIANGLE: usize = 50;

fn read_stl(bytes: &[u8]) -> Result<Triangles, MeshError> {
    let announced = bytes.get(80..STL_HEADER).map(|n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]));
    let expected = STL_HEADER as u64 + STL_TRIANGLE as u64 * u64::from(announced.unwrap_or(0));
    // A binary file, too, may start with "solid": only one of the right length or without text is binary.
    let exact = announced.is_some() && bytes.len() as u64 == expected;
    if !exact && bytes.trim_ascii_start().starts_with(b"solid") && !bytes.contains(&0) {
        return read_text_stl(bytes);
    }
    if announced.is_none() || (bytes.len() as u64) < expected {
        return Err(MeshError::Truncated { expected, found: bytes.len() as u64 });
    }
    let body = &bytes[STL_HEADER..expected as usize];
    Ok(body
        .chunks_exact(STL_TRIANGLE)
        .map(|record| {
            // Twelve bytes of normal come first.
            let number = |i: usize| {
                let at = 12 + 4 * i;
                f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
            };
            [0, 3, 6].map(|corner| [number(corner), number(corner + 1), number(corner + 2)])
        })
        .collect())
}

fn read_text_stl(bytes: &[u8]) -> Result<Triangles, MeshError> {
    let text = String::from_utf8_lossy(bytes);
    let mut triangles = Vec::new();
    let mut corners = Vec::new();
    let mut ended = false;
    let mut last = 0;
    for (i, line) in text.lines().enumerate() {
        last = i + 1;
        let wrong = |what| MeshError::Text { line: i + 1, what };
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("vertex") => {
                let mut coordinate =
                    || words.next().and_then(|w| w.parse().ok()).ok_or(wrong("expected three numbers"));
                corners.push([coordinate()?, coordinate()?, coordinate()?]);
            }
            Some("endfacet") => match corners[..] {
                [a, b, c] => {
                    triangles.push([a, b, c]);
                    corners.clear();
                }
                _ => return Err(wrong("expected three vertices in the facet")),
            },
            Some("endsolid") => ended = true,
            Some("solid" | "facet" | "outer" | "endloop") | None => {}
            Some(_) => return Err(wrong("not a line of an STL file")),
        }
    }
    if ended && corners.is_empty() {
        Ok(triangles)
    } else {
        Err(MeshError::Text { line: last, what: "expected endsolid" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Gallery, Shape};
    use std::io::Write as _;

    /// A box of 2 x 2 x 4 m as a mesh.
    fn cuboid() -> Vec<[[f32; 3]; 3]> {
        let corner = |i: usize| {
            [
                if i & 1 == 0 { -1.0 } else { 1.0 },
                if i & 2 == 0 { -1.0 } else { 1.0 },
                if i & 4 == 0 { -2.0 } else { 2.0f32 },
            ]
        };
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
            .iter()
            .flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]])
            .map(|t| t.map(corner))
            .collect()
    }

    fn binary_stl(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
        let mut bytes = vec![0; 80];
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for t in triangles {
            bytes.extend([0; 12]);
            bytes.extend(t.iter().flatten().flat_map(|c| c.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    fn text_stl(triangles: &[[[f32; 3]; 3]]) -> String {
        let mut text = String::from("solid box\n");
        for t in triangles {
            text += "facet normal 0 0 0\n outer loop\n";
            for [x, y, z] in t {
                text += &format!("  vertex {x} {y} {z}\n");
            }
            text += " endloop\nendfacet\n";
        }
        text + "endsolid box\n"
    }

    fn obj(triangles: &[[[f32; 3]; 3]]) -> String {
        let mut text = String::new();
        for (i, t) in triangles.iter().enumerate() {
            for [x, y, z] in t {
                text += &format!("v {x} {y} {z}\n");
            }
            text += &format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3);
        }
        text
    }

    fn load(suffix: &str, content: &[u8]) -> Result<Mesh, SceneError> {
        let mut file = tempfile::Builder::new().suffix(suffix).tempfile().expect("temporary file");
        file.write_all(content).expect("temporary file");
        let mesh = Mesh::load(file.path(), 1000.0);
        if let Err(e) = &mesh {
            assert!(e.to_string().contains(&*file.path().to_string_lossy()), "{e} does not name the file");
        }
        mesh
    }

    fn reason(suffix: &str, content: &[u8]) -> MeshError {
        match load(suffix, content) {
            Err(SceneError::Mesh { reason, .. }) => reason,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn all_formats_agree_with_the_analytic_square_within_1e_9_mm() {
        let square = Shape::Square { side_mm: 2000.0 };
        let files: [(&str, Vec<u8>); 3] = [
            (".stl", binary_stl(&cuboid())),
            (".STL", text_stl(&cuboid()).into_bytes()),
            (".obj", obj(&cuboid()).into_bytes()),
        ];
        for (suffix, content) in files {
            let mesh = load(suffix, &content).expect("readable");
            for i in 0..1000 {
                let (sin, cos) = (0.37 * f64::from(i)).sin_cos();
                let ray = Ray {
                    origin: Point3::new(0.3 * f64::from(i), -0.2 * f64::from(i), 100.0),
                    direction: Vector3::new(cos, sin, 0.4 * (0.11 * f64::from(i)).sin()).normalize(),
                };
                let (a, b) = (mesh.intersect(&ray).expect("hit"), square.intersect(&ray).expect("hit"));
                assert!((a.point - b.point).norm() < 1e-9, "{suffix}: {a:?} {b:?}");
                assert!((a.normal - b.normal).norm() < 1e-9, "{suffix}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn hierarchy_finds_the_same_triangle_as_a_search_through_all() {
        // A wall of 20 000 triangles in random order of place.
        let gallery = Gallery::new(5, 600.0, 3000.0);
        let at = |i: u32, j: u32| {
            let (sin, cos) = (f64::from(i % 100) * 0.02 * std::f64::consts::PI).sin_cos();
            let z = -2500.0 + 50.0 * f64::from(j);
            let ray = Ray { origin: Point3::new(0.0, 0.0, z), direction: Vector3::new(cos, sin, 0.0) };
            gallery.intersect(&ray).expect("wall").point
        };
        let triangles: Vec<_> = (0..10_000)
            .map(|n| (n * 7919) % 10_000)
            .flat_map(|n| {
                let (i, j) = (n % 100, n / 100);
                let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
            })
            .collect();
        let mesh = Mesh::new(triangles.clone()).expect("mesh");
        for i in 0..200 {
            let (sin, cos) = (0.71 * f64::from(i)).sin_cos();
            let direction = Vector3::new(cos, sin, 0.3 * (0.3 * f64::from(i)).sin()).normalize();
            let ray = Ray { origin: Point3::new(40.0, -30.0, 20.0), direction };
            let nearest = triangles.iter().filter_map(|t| meet_triangle(&ray, t)).min_by(f64::total_cmp).expect("wall");
            assert_eq!(mesh.intersect(&ray).expect("wall").t_mm, nearest);
        }
    }

    #[test]
    fn unusable_files_are_refused_with_the_reason() {
        let stl = binary_stl(&cuboid());
        assert_eq!(reason(".stl", &stl[..300]), MeshError::Truncated { expected: 684, found: 300 });
        assert_eq!(reason(".stl", b""), MeshError::Truncated { expected: 84, found: 0 });
        assert_eq!(reason(".stl", &binary_stl(&[])), MeshError::Empty);
        assert_eq!(reason(".stl", &binary_stl(&[[[1.0; 3]; 3]])), MeshError::Empty);
        assert_eq!(reason(".stl", &binary_stl(&[[[0.0; 3], [1.0, 0.0, 0.0], [f32::NAN; 3]]])), MeshError::NotFinite(0));
        let text = text_stl(&cuboid());
        assert!(matches!(reason(".stl", &text.as_bytes()[..200]), MeshError::Text { .. }));
        assert!(matches!(reason(".stl", b"solid a\nvertex 1 2 three\nendsolid"), MeshError::Text { line: 2, .. }));
        assert_eq!(reason(".stl", b"solid a\nendsolid a"), MeshError::Empty);
        assert_eq!(reason(".obj", b""), MeshError::Empty);
        assert!(matches!(reason(".obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n"), MeshError::Obj(_)));
        assert!(matches!(reason(".obj", b"v 0 zero 0\n"), MeshError::Obj(_)));
        assert_eq!(reason(".ply", &stl), MeshError::Format);
        assert!(matches!(Mesh::load(Path::new("missing.stl"), 1.0), Err(SceneError::Read { .. })));
        assert!(matches!(Mesh::load(Path::new("missing.stl"), 0.0), Err(SceneError::Parameter { .. })));
    }
}
