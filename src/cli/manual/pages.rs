//! The examples and files of every subcommand. The examples of a page run unchanged, one after the other, in an empty
//! directory; `tests/whole/examples.rs` runs them.

/// The manual's content on a subcommand besides its options.
pub(super) struct Page {
    /// The command as typed: `vlscan scene make`.
    pub(super) path: &'static str,
    /// Shell lines with comments; an empty line between examples.
    pub(super) examples: &'static str,
    /// Files that are read or written, with descriptions.
    pub(super) files: &'static [(&'static str, &'static str)],
}

/// Exit statuses, common to all subcommands.
pub(super) const EXIT_STATUS: &[(&str, &str)] = &[
    ("0", "Done. Also when the reader of stdout closes it, as head(1) does."),
    ("1", "The machine failed: a file could not be read or written, the disk is full."),
    ("2", "The input or the command line is wrong; the message says where and what was expected."),
    ("3", "A scan frequency is outside the scanner's limits."),
    (
        "130",
        "Interrupted (Ctrl-C, SIGTERM): files and streams are valid, hold what was done until then and say that they are partial.",
    ),
];

pub(super) const PAGES: &[Page] = &[
    Page {
        path: "vlscan",
        examples: "\
# a small forest with a survey that scans it, its point cloud, and a look at it
vlscan scene make forest -n 20k --pulses 60k -o forest
vlscan run forest/survey.xml -o forest.laz
vlscan preview forest.laz -o forest.html

# how high is the highest return?
vlscan run forest/survey.xml -o - --format xyz -q | awk '$3 > max { max = $3 } END { print max }'

# what can be flown, and with what
vlscan catalogue riegl",
        files: &[
            ("*.xml", "Surveys, scenes, scanners and platforms as HELIOS++ reads them."),
            ("*.toml", "Pipeline files: scene, platform, scanner, settings and outputs in one place."),
        ],
    },
    Page {
        path: "vlscan run",
        examples: "\
# something to scan: a forest and a flight over it
vlscan scene make forest -n 20k --pulses 60k -o forest

# all strips in one file; the ending tells the format
vlscan run forest/survey.xml -o forest.laz

# an octree that viewers load in pieces (COPC); columns for pandas and polars
vlscan run forest/survey.xml -o forest.copc.laz -o forest.parquet

# one file per strip
vlscan run forest/survey.xml -o strips --format las

# as HELIOS++ does: out/SURVEY/TIME/leg000_points.xyz and so on
vlscan run forest/survey.xml --output out --waveforms

# highest point of every object, through a pipe
vlscan run forest/survey.xml -o - --format xyz -q |
  awk '!($9 in z) || $3 > z[$9] { z[$9] = $3 } END { for (o in z) print o, z[o] }' | sort

# legs, points, sizes, memory and time, before it runs
vlscan run forest/survey.xml -o forest.laz --dry-run --force

# tiles of 10 m with heights above the ground
vlscan run forest/survey.xml -o tiles --format laz --tile 10 --height-above-ground

# the reference's known weaknesses switched off, another seed
vlscan run forest/survey.xml -o refined.laz --physics refined --seed 7",
        files: &[
            ("output/SURVEY/TIME/", "Where the files go with neither -o nor --output, as with HELIOS++."),
            ("NAME.vlscan-*.part", "An output that is not complete yet; it gets its name when it is."),
            ("NAME.partial.EXT", "What was measured before a run was interrupted or its input failed."),
            ("helios_TIME.log", "The messages, with --log-file."),
        ],
    },
    Page {
        path: "vlscan index-shards",
        examples: "\
# something to scan
vlscan scene make forest -n 20k --pulses 60k -o forest

# where shards begin, and two shards of two
vlscan index-shards forest/survey.xml -o shards
vlscan run forest/survey.xml --shard 0/2 -o shards
vlscan run forest/survey.xml --shard 1/2 -o shards
vlscan merge shards -o forest.laz",
        files: &[("DIR/flight.vlindex", "The number of pulses, and states of the flight along the way.")],
    },
    Page {
        path: "vlscan merge",
        examples: "\
# something to scan, in four shards, which any number of machines may compute at the same time
vlscan scene make forest -n 20k --pulses 60k -o forest
for shard in 0 1 2 3; do vlscan run forest/survey.xml --shard $shard/4 -o shards; done

# the outputs of one run, as often as they are wanted
vlscan merge shards -o forest.laz -o forest.copc.laz
vlscan merge shards -o - --format xyz -q | head -n 3

# is everything there and sound?
vlscan merge shards --check",
        files: &[("DIR/shard-000003-of-000256.vlshard", "A shard: complete, or absent.")],
    },
    Page {
        path: "vlscan trajectory",
        examples: "\
# something to fly over
vlscan scene make terrain -n 20k --pulses 60k -o terrain

# where was the aeroplane?
vlscan trajectory terrain/survey.xml > flown.csv

# fly the same way again, 200 poses per second
vlscan trajectory terrain/survey.xml --interval 0.005 |
  vlscan run terrain/survey.xml --trajectory - -o again.laz

# the poses as an Arrow stream
vlscan trajectory terrain/survey.xml --format arrow > flown.arrow
vlscan run terrain/survey.xml --trajectory flown.arrow -o once_more.laz

# columns by number, angles in radians, the yaw counter-clockwise from east
awk 'BEGIN { for (i = 0; i <= 400; i++) print i / 200, 1.5708, 0, 0, 0, i / 4 - 50, 300 }' > drone.txt
vlscan run terrain/survey.xml --trajectory drone.txt -o drone.laz --trajectory-angles rad \\
  --trajectory-rotation yaw --trajectory-columns time=1,yaw=2,pitch=3,roll=4,x=5,y=6,z=7",
        files: &[
            (
                "*.csv, *.txt",
                "Poses as text: time, x, y, z, roll, pitch, yaw, or as a first line names them.",
            ),
            ("*.arrow", "The same columns as an Arrow IPC stream or file."),
            ("*.out, *.sbet", "Poses of a navigation system: 17 doubles each (SBET)."),
            ("*.trj", "Poses as TerraScan keeps them."),
        ],
    },
    Page {
        path: "vlscan pulses",
        examples: "\
# something to scan
vlscan scene make terrain -n 20k --pulses 60k -o terrain

# the two halves of a run: the same points as `vlscan run terrain/survey.xml`
vlscan pulses terrain/survey.xml | vlscan trace --scanner terrain/survey.xml -o terrain.laz

# the same through an Arrow stream: quicker, and read by pyarrow and polars
vlscan pulses terrain/survey.xml --format arrow |
  vlscan trace --scanner terrain/survey.xml -o same.laz

# every tenth pulse
vlscan pulses terrain/survey.xml | awk 'NR % 10 == 1' |
  vlscan trace --scanner terrain/survey.xml -o tenth.xyz

# what the columns are
vlscan pulses terrain/survey.xml | head -n 1 | tr , '\\n'",
        files: &[],
    },
    Page {
        path: "vlscan trace",
        examples: "\
# something to scan
vlscan scene make terrain -n 20k --pulses 60k -o terrain

# the same points as `vlscan run terrain/survey.xml`
vlscan pulses terrain/survey.xml | vlscan trace --scanner terrain/survey.xml -o terrain.laz

# the same flight with the receiver of another instrument
vlscan pulses terrain/survey.xml |
  vlscan trace --scene terrain/survey.xml --scanner riegl_vq-880g --max-returns 1 -o other.laz

# a scan pattern of one's own: a spiral of pulses from one place
awk 'BEGIN { OFS = \",\"; print \"time,x,y,z,dx,dy,dz\"
  for (i = 0; i < 36000; i++) { a = i * 0.0174533; r = i / 36000
    print i * 1e-5, 0, 0, 250, r * cos(a), r * sin(a), -1 } }' |
  vlscan trace --scene terrain/survey.xml --scanner riegl_vz400 > spiral.xyz",
        files: &[],
    },
    Page {
        path: "vlscan scene",
        examples: "\
# make a scene, see what it holds
vlscan scene make room -o room
vlscan scene info room/scene.xml#room",
        files: &[],
    },
    Page {
        path: "vlscan scene make",
        examples: "\
# a forest of 20 000 triangles in which each tree is an object of its own
vlscan scene make forest -n 20k --separate-trees -o forest

# another forest
vlscan scene make forest -n 20k --seed 2 -o forest2

# two million triangles of which 20 thousand are stored
vlscan scene make forest -n 2M --models 10 --copies 100 -o large

# hills, 500 m wide
vlscan scene make terrain --extent 500 -o hills",
        files: &[
            ("DIR/survey.xml", "The survey: vlscan run DIR/survey.xml"),
            ("DIR/scene.xml", "The scene, with its *.obj and *.mtl beside it."),
            ("DIR/scanners.xml, DIR/platforms.xml", "What the survey flies."),
        ],
    },
    Page {
        path: "vlscan scene stand",
        examples: "\
# tree models, terrain and inventory
vlscan scene make forest -n 20k -o forest
mkdir -p models && cp forest/beech.obj forest/spruce.obj forest/forest.mtl models
printf '%s\\n' x,y,height,species -8,3,12,beech 0,0,18,spruce 6,-4,15,beech > plot.csv

vlscan scene stand plot.csv --trees models --terrain forest/ground.obj -o stand
vlscan scene info stand/stand.xml",
        files: &[("labels.csv", "Number of the part in the points, id, species, model, place, height, crown, dbh.")],
    },
    Page {
        path: "vlscan scene info",
        examples: "\
vlscan scene make forest -n 20k -o forest

# parts, triangles, materials, memory
vlscan scene info forest/survey.xml

# for programs
vlscan scene info forest/survey.xml --json",
        files: &[],
    },
    Page {
        path: "vlscan scene pack",
        examples: "\
vlscan scene make forest -n 20k -o forest

# everything that tracing needs in one file
vlscan scene pack forest/survey.xml -o forest.vlscene

# the same points, without loading meshes and building the tree
vlscan run forest/survey.xml --scene forest.vlscene -o points.laz

# is the file sound?
vlscan scene info forest.vlscene --verify",
        files: &[],
    },
    Page {
        path: "vlscan campaign",
        examples: "\
vlscan scene make forest -n 20k -o forest

# the forest from two heights, with three seeds each
cat > campaign.toml << 'END'
out = \"dataset\"
seeds = 3
[[scene]]
name = \"forest\"
file = \"forest/scene.xml#forest\"
area = \"POLYGON ((-10 -10, 10 -10, 10 10, -10 10))\"
[[variant]]
name = \"low\"
plan = \"airborne --scanner riegl_vux-1uav --height 50 --density 20\"
[[variant]]
name = \"high\"
plan = \"airborne --scanner riegl_vux-1uav --height 90 --density 20\"
END
vlscan campaign campaign.toml",
        files: &[
            ("OUT/manifest.jsonl", "A line per cell: inputs, options, counts, density, bounds, files, or why it failed."),
            ("OUT/cells/NAME/", "The points of a cell, objects.csv, record.json; complete or absent."),
            ("OUT/times.jsonl", "Seconds of each cell; not part of the data set."),
            ("OUT/.campaign/", "Locks, unfinished files, failures."),
        ],
    },
    Page {
        path: "vlscan bench",
        examples:
            "\
vlscan scene make terrain -n 20k --pulses 60k -o terrain

# two trees, one and two threads: a table; every cell as JSON; a picture
vlscan bench terrain/survey.xml --tree bvh,fsah -j 1,2 --json cells.json --svg cells.svg

# how four schedules would fare on 64 threads, from task times measured here
vlscan bench terrain/survey.xml --tree bvh --schedule single,static,dynamic,warehouse --simulate-threads 2,64",
        files: &[],
    },
    Page {
        path: "vlscan plan",
        examples: "\
vlscan plan airborne --scanner riegl_lms-q780 --area 'POLYGON ((0 0, 900 0, 900 400, 0 400))' --height 500 --density 8",
        files: &[],
    },
    Page {
        path: "vlscan plan airborne",
        examples: "\
vlscan scene make terrain -n 20k -o terrain

# a drone over the scene, ten pulses per square metre, 50 % overlap, at the same height above hill and valley
vlscan plan airborne --scanner riegl_vux-1uav --scene terrain/scene.xml --height 80 --density 10 --overlap 50 \
  --follow-terrain -o flight.toml

# an aeroplane: speed and density are given, the distance of the lines follows; cross lines, turns of 600 m
vlscan plan airborne --scanner riegl_lms-q780 --area 'POLYGON ((0 0, 900 0, 900 400, 0 400))' --height 500 \
  --speed 60 --density 12 --cross-lines 2 --turn-radius 600 > wide.toml",
        files: &[("*.geojson, *.wkt", "Areas and lines in the scene's coordinates.")],
    },
    Page {
        path: "vlscan plan terrestrial",
        examples: "\
vlscan scene make forest -n 20k -o forest

# four positions around a plot and one in its middle
vlscan plan terrestrial --scanner riegl_vz400 --scene forest/scene.xml --around 0,0 --radius 12 --at-centre \
  --resolution 0.1 -o plot.toml

# a grid of positions
vlscan plan terrestrial --scanner riegl_vz400 --scene forest/scene.xml --spacing 15 -o grid.toml",
        files: &[],
    },
    Page {
        path: "vlscan plan mobile",
        examples: "\
# a car with a spinning scanner
vlscan plan mobile --scanner vlp16 --along 'LINESTRING (0 0, 100 0, 100 50)' --speed 8 -o drive.toml",
        files: &[],
    },
    Page {
        path: "vlscan catalogue",
        examples: "\
# everything that ships
vlscan catalogue

# airborne instruments of RIEGL
vlscan catalogue riegl

# for programs
vlscan catalogue --json",
        files: &[],
    },
    Page {
        path: "vlscan catalogue show",
        examples: "\
# the figures of a scanner
vlscan catalogue show vlp16

# and where its beams point
vlscan catalogue show livox_mid-40 --picture mid-40.svg",
        files: &[],
    },
    Page {
        path: "vlscan unzip",
        examples: "\
vlscan scene make room -n 2k --pulses 20k -o room
vlscan run room/survey.xml -o points.bin

# the text that it holds
vlscan unzip points.bin points.xyz
vlscan unzip points.bin -q | head -3",
        files: &[("*.bin", "Text as HELIOS++ compresses it with --zipOutput.")],
    },
    Page {
        path: "vlscan compare",
        examples: "\
vlscan scene make forest -n 20k --pulses 60k -o forest
vlscan run forest/survey.xml -o first.laz
vlscan run forest/survey.xml --seed 2 -o second.laz

vlscan compare first.laz second.laz
vlscan compare first.laz second.laz --page compared.html --json > compared.json",
        files: &[],
    },
    Page {
        path: "vlscan preview",
        examples: "\
vlscan scene make forest -n 20k --pulses 60k -o forest
vlscan run forest/survey.xml -o forest.laz

# a picture from above and from the side
vlscan preview forest.laz -o forest.png
vlscan preview forest.laz -o classes.png --colour class

# a survey before it is flown: flight lines, and what they cover of the scene
vlscan preview forest/survey.xml -o flight.png

# one file to turn around in a browser, also without a network; a smaller one to mail
vlscan preview forest.laz -o forest.html
vlscan preview forest.laz -o small.html --most-points 20k

# points from a pipe
vlscan run forest/survey.xml -o - --format xyz -q | vlscan preview - -o piped.html

# the waveform of the first pulse with three echoes
vlscan run forest/survey.xml --output out --waveforms -q
pulse=$(awk '$7 == 3 { print $8; exit }' out/forest/*/strip001_points.xyz)
vlscan preview out/forest/*/strip001_fullwave.txt --pulse $pulse -o pulse.png
# and from packets within LAZ
vlscan run forest/survey.xml -o waves.laz --wave-packets inside -q
vlscan preview waves.laz --pulse $pulse -o packet.png

# points as a table
vlscan run forest/survey.xml -o trees.arrow -q
vlscan preview trees.arrow -o returns.png --colour return",
        files: &[
            (
                "*_fullwave.txt, *_fullwave.bin",
                "Waveforms, for --pulse; text may be compressed with gzip(1).",
            ),
            ("*.las, *.laz", "With --pulse: files with waveform packets, inside or beside (.wdp)."),
            ("*.html", "A page that holds its points, drawn with WebGL 2; it fetches nothing."),
            ("NAME.vlscan-*.part", "A file that is not complete yet."),
        ],
    },
    Page {
        path: "vlscan completions",
        examples: "\
# for this shell and this user; open a new shell afterwards
mkdir -p ~/.local/share/bash-completion/completions
vlscan completions bash > ~/.local/share/bash-completion/completions/vlscan

# zsh: into a folder of $fpath
mkdir -p ~/.zfunc
vlscan completions zsh > ~/.zfunc/_vlscan

# fish
mkdir -p ~/.config/fish/completions
vlscan completions fish > ~/.config/fish/completions/vlscan.fish",
        files: &[
            ("~/.local/share/bash-completion/completions/vlscan", "Where bash looks."),
            ("~/.config/fish/completions/vlscan.fish", "Where fish looks."),
        ],
    },
];
