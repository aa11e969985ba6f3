use std::path::PathBuf;

/// Why a scene cannot be rendered or a mesh not loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A mesh file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A mesh file does not hold a usable mesh.
    #[error("{}: {reason}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: MeshError,
    },
    /// A parameter of the scene is not finite or out of its range.
    #[error("{name} is {value}, which is not {expected}")]
    Parameter {
        /// Field of the scene.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        expected: &'static str,
    },
    /// The rig gives a camera neither an air nor a water model.
    #[error("camera {0} has neither an air nor a water model")]
    NoModel(usize),
    /// The rig's image size is zero or beyond 64 megapixels.
    #[error("camera {camera} has an image of {width} x {height} px")]
    ImageSize {
        /// Index of the camera.
        camera: usize,
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
    },
    /// Too few poses were found from which both cameras see a whole board.
    #[error(
        "found {found} of {count} poses in which both cameras see all corners of the board: it is too large or too small"
    )]
    NoBoardPose {
        /// Poses found.
        found: usize,
        /// Poses asked for.
        count: usize,
    },
    /// The origin of the instrument lies in or behind the wall.
    #[error("the instrument is outside the shape")]
    Outside,
}

/// What is wrong with a mesh.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file name ends in neither `.obj` nor `.stl`.
    #[error("not a Wavefront OBJ (.obj) or stereolithography (.stl) file name")]
    Format,
    /// A binary STL file ends early.
    #[error("truncated: {expected} bytes announced, {found} found")]
    Truncated {
        /// Bytes the header announces.
        expected: u64,
        /// Bytes in the file.
        found: u64,
    },
    /// A line of a text file cannot be understood.
    #[error("line {line}: {what}")]
    Text {
        /// Line, counted from one.
        line: usize,
        /// What was expected there.
        what: &'static str,
    },
    /// The OBJ reader refused the file.
    #[error("{0}")]
    Obj(String),
    /// A coordinate is infinite or not a number.
    #[error("triangle {0} has a coordinate that is not finite")]
    NotFinite(usize),
    /// No triangle with an area.
    #[error("no triangles")]
    Empty,
}
