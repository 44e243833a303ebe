//! The kinds of files, with their first bytes, their endings and what to do with them.

use super::Family::{self, *};

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Its name with an article, as it stands in "found a NumPy array".
    pub name: &'static str,
    /// Content of such files.
    pub family: Family,
    /// How to convert it to a format that vlscan reads, with `{f}` for the file; empty if vlscan reads it.
    pub(super) convert: &'static str,
    /// First bytes of such files.
    pub(super) starts: &'static [&'static [u8]],
    /// The endings of their names, in small letters.
    pub(super) endings: &'static [&'static str],
}

const fn kind(
    name: &'static str,
    family: Family,
    convert: &'static str,
    starts: &'static [&'static [u8]],
    endings: &'static [&'static str],
) -> Kind {
    Kind { name, family, convert, starts, endings }
}

const MESH: &str =
    "convert it to glTF: assimp export {f} out.glb, or export it as glTF or OBJ from Blender or MeshLab";
const CAD: &str = "export it as OBJ or glTF from the program that made it, or from FreeCAD";
const IFC: &str =
    "convert it to glTF: IfcConvert {f} out.glb (IfcOpenShell), or export it from Blender (Bonsai)";
const CITY: &str =
    "convert it to OBJ: cjio {f} export obj out.obj; CityGML first: citygml-tools to-cityjson {f}";
const GDAL: &str = "convert it to GeoTIFF: gdal_translate -co COMPRESS=DEFLATE {f} out.tif";
const OGR: &str = "convert it to GeoJSON: ogr2ogr -f GeoJSON out.geojson {f}";
const PDAL: &str = "convert it to LAZ: pdal translate {f} out.laz, or export LAZ from CloudCompare";
const MAKER: &str = "export it as LAS, LAZ or E57 from the program of the scanner's maker";
const BAG: &str =
    "convert it to MCAP: mcap convert {f} out.mcap, or write its points and poses as tables of text";
const ARRAY: &str = "write its numbers as a table of text: numpy.savetxt('out.txt', numpy.load('{f}'))";
const SHEET: &str = "save it as CSV: libreoffice --headless --convert-to csv {f}";
const CSV: &str = "write it as CSV or Parquet, for example with Polars or pandas";
const VTK: &str = "export it as OBJ, PLY or STL from ParaView";
const NONE: &str = "it contains nothing that vlscan reads";

/// A list of geometries in XML.
pub(super) const GML: Kind = kind("GML", Area, OGR, &[], &["gml"]);
/// A city model in XML.
pub(super) const CITYGML: Kind = kind("a CityGML model", Mesh, CITY, &[], &["citygml"]);
/// A text that begins with a byte order mark of UTF-16.
pub(super) const UTF16: Kind =
    kind("text in UTF-16", Utf16, "save it as UTF-8: iconv -f UTF-16 -t UTF-8 {f} > out.txt", &[], &[]);
/// Lines of columns.
pub(super) const TABLE: Kind = kind("a table of text", Table, "", &[], &["csv", "tsv"]);
/// Text without columns.
pub(super) const TEXT: Kind = kind("text of an unknown format", Text, "", &[], &[]);
/// Bytes that are not text.
pub(super) const BINARY: Kind = kind("binary data of an unknown format", Binary, "", &[], &[]);
/// Kinds of contents that say little: any reader may take them by their name.
pub(super) const GENERAL: [Kind; 3] = [TABLE, TEXT, BINARY];
/// No bytes.
pub(super) const EMPTY: Kind = kind("an empty file", Empty, "", &[], &[]);
/// JSON without known keys.
pub(super) const JSON: Kind = kind("a JSON file", Markup, "", &[], &["json"]);
/// XML with an unknown root.
pub(super) const XML: Kind = kind("an XML file", Markup, "", &[], &["xml"]);
/// A document of surveys, scenes or instruments.
pub(super) const DOCUMENT: Kind = kind("an XML document of vlscan or HELIOS++", Document, "", &[], &[]);
/// A pipeline in TOML.
pub(super) const PIPELINE: Kind = kind("a pipeline file (TOML)", Pipeline, "", &[], &["toml"]);
/// An archive whose first entry says nothing.
pub(super) const ZIP: Kind =
    kind("a ZIP archive", Archive, "unpack it: unzip {f}", &[b"PK\x03\x04", b"PK\x05\x06"], &["zip"]);
/// Geometries of Google Earth, packed.
pub(super) const KMZ: Kind = kind("KMZ (zipped KML)", Area, "", &[], &["kmz"]);
/// Arrays of NumPy, packed.
pub(super) const NPZ: Kind = kind("an archive of NumPy arrays", Array, ARRAY, &[], &["npz"]);
/// A workbook of Excel.
pub(super) const EXCEL: Kind = kind("an Excel workbook", Sheet, SHEET, &[], &["xlsx", "xlsm", "xls"]);
/// A spreadsheet of LibreOffice.
pub(super) const ODS: Kind = kind("an OpenDocument spreadsheet", Sheet, SHEET, &[], &["ods"]);
/// A document of Word or LibreOffice.
pub(super) const OFFICE: Kind = kind("an office document", Other, NONE, &[], &["docx", "doc", "odt", "pptx"]);
/// USD, packed.
pub(super) const USDZ: Kind =
    kind("a USD scene", Mesh, MESH, &[b"#usda", b"PXR-USDC"], &["usd", "usda", "usdc", "usdz"]);
/// Meshes for printers, packed.
pub(super) const PRINT: Kind = kind("a 3MF mesh", Mesh, MESH, &[], &["3mf"]);
/// A database of SQLite without a known application.
pub(super) const SQLITE: Kind = kind(
    "an SQLite database",
    Other,
    "export its tables as CSV: sqlite3 -csv {f}",
    &[b"SQLite format 3\0"],
    &["sqlite", "sqlite3"],
);
/// A database of the OGC.
pub(super) const GPKG: Kind = kind("a GeoPackage", Area, "", &[], &["gpkg"]);
/// A log of ROS 2.
pub(super) const ROS2: Kind = kind("a ROS 2 bag", Log, BAG, &[], &["db3"]);
/// LAS, compressed.
pub(super) const LAZ: Kind = kind("a LAZ point cloud", Points, "", &[], &["laz"]);
/// LAZ, ordered as an octree.
pub(super) const COPC: Kind = kind("a COPC point cloud", Points, "", &[], &[]);
/// The index of a shapefile.
pub(super) const SHX: Kind =
    kind("the index of a shapefile", Area, "name the .shp file beside it", &[], &["shx"]);
/// The table of a shapefile.
pub(super) const DBF: Kind = kind(
    "a dBASE table (of a shapefile)",
    Area,
    "the geometries are in the .shp file beside it; its columns: ogr2ogr -f CSV out.csv {f}",
    &[],
    &["dbf"],
);
/// A trajectory of Applanix.
pub(super) const SBET: Kind = kind("an SBET trajectory", Flight, "", &[], &["sbet"]);
/// A wavefront object.
pub(super) const OBJ: Kind = kind("an OBJ mesh", Mesh, "", &[], &["obj"]);
/// Compressed lines of text.
pub(super) const COMPRESSED_TEXT: Kind = kind(
    "compressed text of vlscan or HELIOS++ (.bin)",
    Archive,
    "expand it: vlscan unzip {f} out.txt",
    &[b"x\xda", b"x\x9c"],
    &[],
);
/// Columns of Apache Parquet.
pub(super) const PARQUET: Kind = kind("a Parquet table", Columnar, "", &[b"PAR1"], &["parquet"]);
/// A mesh of triangles.
pub(super) const STL: Kind = kind("an STL mesh", Mesh, "", &[], &["stl"]);
/// A mesh of 3D Studio.
pub(super) const STUDIO: Kind = kind("a 3D Studio mesh", Mesh, MESH, &[], &["3ds"]);
/// Geometries in JSON.
pub(super) const GEOJSON: Kind = kind("GeoJSON", Area, "", &[], &["geojson"]);
/// Geometries in words.
pub(super) const WKT: Kind = kind("well-known text of a geometry", Area, "", &[], &["wkt"]);
/// A coordinate reference system.
pub(super) const PRJ: Kind = kind("a coordinate reference system in WKT", System, "", &[], &["prj"]);
/// A calibration of Ouster.
pub(super) const OUSTER: Kind = kind("the calibration of an Ouster sensor", Calibration, "", &[], &[]);
/// A mesh in JSON.
pub(super) const GLTF: Kind = kind("a glTF mesh", Mesh, "", &[b"glTF"], &["gltf", "glb"]);
/// A city model in JSON.
pub(super) const CITYJSON: Kind = kind("a CityJSON model", Mesh, CITY, &[], &["cityjson"]);
/// Metadata of clouds in tiles.
pub(super) const CLOUD_TILES: Kind = kind(
    "the index of a tiled point cloud (Potree, EPT, 3D Tiles)",
    Points,
    "convert it to LAZ with PDAL: readers.ept for EPT; otherwise name the file it was made of",
    &[],
    &[],
);
/// Points in lines of text.
pub(super) const TEXT_POINTS: Kind = kind("a point cloud of text", Points, "", &[], &["xyz", "pts", "ptx"]);
/// A scene in XML.
pub(super) const COLLADA: Kind = kind("a COLLADA scene", Mesh, MESH, &[], &["dae"]);
/// A scene of the web.
pub(super) const X3D: Kind =
    kind("a VRML or X3D scene", Mesh, MESH, &[b"#VRML", b"#X3D"], &["wrl", "vrml", "x3d"]);
/// Surfaces of civil engineering.
pub(super) const LANDXML: Kind = kind("LandXML", Mesh, CAD, &[], &["landxml"]);
/// Geometries of Google Earth.
pub(super) const KML: Kind = kind("KML", Area, "", &[], &["kml"]);
/// Tracks of receivers.
pub(super) const GPX: Kind = kind("GPX", Area, "", &[], &["gpx"]);
/// Streets and houses.
pub(super) const OSM: Kind = kind("OpenStreetMap data", Area, OGR, &[], &["osm", "pbf"]);
/// Geometries in JSON with shared borders.
pub(super) const TOPOJSON: Kind = kind("TopoJSON", Area, OGR, &[], &["topojson"]);
/// Data of ParaView.
pub(super) const VTK_XML: Kind =
    kind("a VTK data set", Mesh, VTK, &[b"# vtk DataFile"], &["vtk", "vtp", "vtu", "vti", "vts", "vtr"]);
/// A drawing.
pub(super) const SVG: Kind = kind("an SVG drawing", Picture, NONE, &[], &["svg"]);
/// A robot or its world.
pub(super) const ROBOT: Kind = kind(
    "a scene of a simulator (SDF, URDF, MuJoCo, Mitsuba)",
    Mesh,
    "name the meshes in it (OBJ, STL, PLY, glTF) as parts of a scene",
    &[],
    &["sdf", "urdf", "world"],
);
/// Source text of a program.
pub(super) const PROGRAM: Kind =
    kind("a Python program", Other, "run it with python3; `import vlscan` is the module", &[], &["py"]);
/// Another program.
pub(super) const SCRIPT: Kind = kind(
    "a program",
    Other,
    NONE,
    &[b"\x7fELF", b"MZ\x90\0", b"\xca\xfe\xba\xbe", b"\xcf\xfa\xed\xfe", b"\0asm"],
    &["exe", "dll", "so", "sh", "bat", "rs", "c", "cpp", "js"],
);
/// A notebook of Jupyter.
pub(super) const NOTEBOOK: Kind = kind(
    "a Jupyter notebook",
    Other,
    "run it with Jupyter; `import vlscan` is the Python module",
    &[],
    &["ipynb"],
);
/// A page.
pub(super) const HTML: Kind = kind(
    "an HTML page",
    Other,
    "it may be the page of a failed download; open it in a browser",
    &[],
    &["html", "htm"],
);
/// BIM.
pub(super) const IFC_MODEL: Kind = kind("an IFC model", Mesh, IFC, &[], &["ifc", "ifczip", "ifcxml"]);
/// CAD.
pub(super) const STEP: Kind = kind("a STEP model", Mesh, CAD, &[b"ISO-10303-21"], &["step", "stp"]);
/// A raster of several files.
pub(super) const VRT: Kind = kind("a virtual raster of GDAL (VRT)", Terrain, "", &[], &["vrt"]);
/// Files in a row.
pub(super) const TAR: Kind = kind("a TAR archive", Archive, "unpack it: tar -xf {f}", &[], &["tar", "tgz"]);
/// A mesh of OFF.
pub(super) const OFF: Kind = kind("an OFF mesh", Mesh, "", &[], &["off"]);
/// A raster in lines of text.
pub(super) const ESRI_GRID: Kind = kind("an ESRI ASCII grid", Terrain, "", &[], &["asc", "grd"]);
/// A mesh or a cloud.
pub(super) const PLY: Kind = kind("a PLY file", PointsOrMesh, "", &[], &["ply"]);
/// A cloud of the Point Cloud Library.
pub(super) const PCD: Kind = kind("a PCD point cloud", Points, "", &[], &["pcd"]);
/// Materials of OBJ.
pub(super) const MTL: Kind = kind("an MTL material library", Materials, "", &[], &["mtl"]);
/// A drawing of AutoCAD.
pub(super) const DXF: Kind = kind("a DXF drawing", Mesh, CAD, &[b"AutoCAD Binary DXF"], &["dxf"]);

/// Roads of a driving simulator.
pub(super) const OPENDRIVE: Kind = kind(
    "an OpenDRIVE road network",
    Mesh,
    "export its surfaces as OBJ or glTF, for example with libOpenDRIVE or RoadRunner",
    &[],
    &["xodr"],
);
/// Tracks of Garmin's devices.
pub(super) const TCX: Kind = kind(
    "a TCX track",
    Area,
    "convert it to GPX: gpsbabel -i gtrnctr -f {f} -o gpx -F out.gpx",
    &[],
    &["tcx"],
);
/// Messages of a receiver.
pub(super) const NMEA: Kind = kind(
    "a log of a GNSS receiver (NMEA 0183)",
    Area,
    "convert it to GPX: gpsbabel -i nmea -f {f} -o gpx -F out.gpx",
    &[],
    &["nmea"],
);
/// Tracks of gliders.
pub(super) const IGC: Kind = kind(
    "an IGC flight log",
    Area,
    "convert it to GPX: gpsbabel -i igc -f {f} -o gpx -F out.gpx",
    &[],
    &["igc"],
);
/// Observations of a receiver.
pub(super) const RINEX: Kind = kind(
    "raw observations of a GNSS receiver (RINEX)",
    Other,
    "compute positions first, for example with RTKLIB",
    &[],
    &["rnx"],
);

/// Kinds that are archives of ZIP.
pub(super) const IN_ZIP: &[Kind] = &[KMZ, NPZ, EXCEL, ODS, OFFICE, USDZ, PRINT, IFC_MODEL];

/// Kinds that are recognised by [`super::contents`]; their endings count.
pub(super) const BY_CONTENTS: &[Kind] = &[
    GML,
    CITYGML,
    TABLE,
    JSON,
    XML,
    PIPELINE,
    KMZ,
    NPZ,
    EXCEL,
    ODS,
    OFFICE,
    PRINT,
    GPKG,
    ROS2,
    LAZ,
    SHX,
    DBF,
    SBET,
    OBJ,
    STL,
    STUDIO,
    GEOJSON,
    WKT,
    PRJ,
    CITYJSON,
    PROGRAM,
    NOTEBOOK,
    HTML,
    IFC_MODEL,
    VRT,
    TAR,
    OFF,
    ESRI_GRID,
    PLY,
    PCD,
    MTL,
    TEXT_POINTS,
    COLLADA,
    LANDXML,
    KML,
    GPX,
    OSM,
    TOPOJSON,
    SVG,
    ROBOT,
    OPENDRIVE,
    TCX,
    NMEA,
    IGC,
    RINEX,
];

/// Kinds that are recognised by their first bytes.
pub(super) const BY_START: &[Kind] = &[
    kind("a LAS point cloud", Points, "", &[b"LASF"], &["las"]),
    kind("an E57 point cloud", Points, "", &[b"ASTM-E57"], &["e57"]),
    PARQUET,
    kind(
        "an encrypted Parquet table",
        Other,
        "decrypt it and write it again as Parquet or CSV",
        &[b"PARE"],
        &[],
    ),
    kind("an Arrow table", Columnar, "", &[b"ARROW1\0\0", b"\xff\xff\xff\xff"], &["arrow", "ipc"]),
    kind(
        "a Feather table of version 1",
        Other,
        "write it again: pyarrow.feather.write_feather(pyarrow.feather.read_table('{f}'), 'out.arrow', \
         compression='uncompressed')",
        &[b"FEA1"],
        &["feather"],
    ),
    kind("an ORC table", Other, CSV, &[b"ORC"], &["orc"]),
    kind("an MCAP log", Log, "", &[b"\x89MCAP0"], &["mcap"]),
    kind("a ROS bag", Log, BAG, &[b"#ROSBAG"], &[]),
    kind(
        "a packet capture (pcap)",
        Log,
        "convert it to LAS with the software of the sensor's maker, or with LidarView",
        &[
            b"\xd4\xc3\xb2\xa1",
            b"\xa1\xb2\xc3\xd4",
            b"\x4d\x3c\xb2\xa1",
            b"\xa1\xb2\x3c\x4d",
            b"\x0a\x0d\x0d\x0a",
        ],
        &["pcap", "pcapng"],
    ),
    kind(
        "a RIEGL RDB database",
        Points,
        "export LAZ with RiSCAN PRO, RiPROCESS or rdbconvert",
        &[b"RIEGL LMS RDB"],
        &["rdb", "rdbx"],
    ),
    kind(
        "a file of a scanner's maker",
        Points,
        MAKER,
        &[],
        &["rxp", "fls", "fws", "lsproj", "zfs", "zfc", "imp", "clr", "cl3", "rcp", "rcs", "lgs", "pcg"],
    ),
    kind("a BPF point cloud", Points, PDAL, &[b"BPF!"], &["bpf"]),
    kind("a CloudCompare project", Points, "save it as LAZ or E57 in CloudCompare", &[b"CCB2"], &[]),
    kind("a LASzip index", Other, "name the .las or .laz file beside it", &[b"LASX"], &["lax"]),
    kind("a NumPy array", Array, ARRAY, &[b"\x93NUMPY"], &["npy"]),
    kind(
        "a file of Python objects (pickle)",
        Array,
        CSV,
        &[b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05"],
        &["pkl", "pickle", "pt", "pth"],
    ),
    kind("a MATLAB file", Array, CSV, &[b"MATLAB 5.0"], &["mat"]),
    kind("a file of R", Array, CSV, &[b"RDX", b"RDA"], &["rds", "rda", "rdata"]),
    kind(
        "an HDF5 or NetCDF 4 file",
        Array,
        "a raster in it becomes GeoTIFF: gdal_translate {f} out.tif; tables in it: write them as CSV with \
         h5py",
        &[b"\x89HDF"],
        &["h5", "hdf5", "hdf", "he5"],
    ),
    kind("a NetCDF file", Array, GDAL, &[b"CDF\x01", b"CDF\x02", b"CDF\x05"], &["nc", "nc4"]),
    kind("a GRIB file", Terrain, GDAL, &[b"GRIB"], &["grib", "grb", "grib2"]),
    kind("a TIFF raster", Terrain, "", &[b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"], &["tif", "tiff", "gtiff"]),
    kind("an ERDAS Imagine raster", Terrain, GDAL, &[b"EHFA_HEADER_TAG"], &["img"]),
    kind("a Surfer grid", Terrain, GDAL, &[b"DSAA\n", b"DSAA\r", b"DSBB", b"DSRB"], &[]),
    kind(
        "a raster in another format of GDAL",
        Terrain,
        GDAL,
        &[b"\0\0\0\x0cjP", b"Lerc2 ", b"CntZImage", b"msid"],
        &["jp2", "hgt", "dem", "ecw", "sid", "bil", "flt", "dt1", "dt2", "adf", "lrc"],
    ),
    kind("a world file", Other, "name the raster beside it", &[], &["tfw", "wld", "jgw", "pgw"]),
    kind("an FBX mesh", Mesh, MESH, &[b"Kaydara FBX", b"; FBX"], &["fbx"]),
    kind("a Blender file", Mesh, "export it as glTF or OBJ from Blender", &[b"BLENDER"], &["blend"]),
    kind("a Draco mesh", Mesh, "decode it: draco_decoder -i {f} -o out.ply", &[b"DRACO"], &["drc"]),
    kind("an IGES model", Mesh, CAD, &[], &["igs", "iges"]),
    kind("a DWG drawing", Mesh, CAD, &[b"AC10"], &["dwg"]),
    kind("a Rhino model", Mesh, CAD, &[b"3D Geometry File Format"], &["3dm"]),
    kind(
        "a model of SketchUp, SolidWorks or 3ds Max",
        Mesh,
        CAD,
        &[],
        &["skp", "sldprt", "sldasm", "max", "c4d", "ma", "mb"],
    ),
    kind(
        "a MagicaVoxel model",
        Mesh,
        "export it as OBJ or PLY from MagicaVoxel",
        &[b"VOX \x96", b"VOX \xc8", b"VOX "],
        &[],
    ),
    kind("a voxel file of AMAPVox", Voxels, "", &[b"VOXEL SPACE"], &["vox"]),
    kind("a VDB volume", Mesh, "make a mesh of it in Blender or ParaView", &[b" BDV"], &["vdb"]),
    kind("a shapefile", Area, "", &[b"\0\0\x27\x0a"], &["shp"]),
    kind("a FlatGeobuf file", Area, OGR, &[b"fgb\x03fgb"], &["fgb"]),
    kind("a MapInfo file", Area, OGR, &[b"!table"], &["mif"]),
    kind("a TerraScan trajectory", Flight, "", &[b"TSCANTRJ"], &["trj"]),
    kind("a packed scene of vlscan", Packed, "", &[b"VLSCENE\n"], &["vlscene"]),
    kind("a shard of vlscan", Shard, "", &[b"VLSHARD\n", b"VLBLOCK\n", b"VLINDEX\n"], &["shard"]),
    COMPRESSED_TEXT,
    kind("a gzip file", Archive, "unpack it: gunzip {f}", &[b"\x1f\x8b"], &["gz"]),
    kind("a Zstandard file", Archive, "unpack it: unzstd {f}", &[b"\x28\xb5\x2f\xfd"], &["zst"]),
    kind("a bzip2 file", Archive, "unpack it: bunzip2 {f}", &[b"BZh"], &["bz2"]),
    kind("an XZ file", Archive, "unpack it: unxz {f}", &[b"\xfd7zXZ"], &["xz"]),
    kind("an LZ4 file", Archive, "unpack it: unlz4 {f}", &[b"\x04\x22\x4d\x18"], &["lz4"]),
    kind("a 7z archive", Archive, "unpack it: 7z x {f}", &[b"7z\xbc\xaf"], &["7z"]),
    kind("a RAR archive", Archive, "unpack it: unrar x {f}", &[b"Rar!"], &["rar"]),
    kind(
        "a PNG picture",
        Picture,
        "a raster of heights becomes GeoTIFF: gdal_translate {f} out.tif",
        &[b"\x89PNG"],
        &["png"],
    ),
    kind(
        "a JPEG picture",
        Picture,
        "a raster of heights becomes GeoTIFF: gdal_translate {f} out.tif",
        &[b"\xff\xd8\xff"],
        &["jpg", "jpeg"],
    ),
    kind(
        "a picture",
        Picture,
        NONE,
        &[b"GIF8", b"BM", b"P5\n", b"P6\n", b"8BPS", b"\0\0\x01\0"],
        &["gif", "bmp", "pgm", "ppm", "webp", "psd"],
    ),
    kind(
        "a film or a sound",
        Other,
        NONE,
        &[b"RIFF", b"OggS", b"ID3"],
        &["mp4", "avi", "mov", "mkv", "wav", "mp3"],
    ),
    kind("a PDF document", Other, NONE, &[b"%PDF"], &["pdf"]),
    kind(
        "an OLE compound file (FARO scan, Excel 97, 3ds Max)",
        Other,
        "export it from its program: scans as E57 or LAZ, tables as CSV, meshes as OBJ",
        &[b"\xd0\xcf\x11\xe0"],
        &[],
    ),
    GLTF,
    USDZ,
    ZIP,
    SQLITE,
    STEP,
    DXF,
    SCRIPT,
    X3D,
    VTK_XML,
];
