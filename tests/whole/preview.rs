//! `vlscan preview`: interactive pages as a browser shows them, and plots of waveforms. Needs Chromium, on
//! the path or named by `VLSCAN_CHROMIUM`.

use crate::common;
use crate::common::{files, fixture, folder, run, succeed, text};
use std::collections::HashSet;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Stdio};

/// A browser, or `None` where there is none.
fn chromium() -> Option<String> {
    let named = std::env::var("VLSCAN_CHROMIUM").ok();
    let usual = ["chromium", "chromium-browser", "google-chrome"].map(str::to_owned);
    for program in named.into_iter().chain(usual) {
        let found =
            Command::new(&program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if found.is_ok_and(|status| status.success()) {
            return Some(program);
        }
    }
    common::missing("chromium", "apt install chromium, or name one in VLSCAN_CHROMIUM");
    None
}

/// A page as the browser rendered it.
struct Seen {
    document: String,
    messages: String,
    /// Width, and red, green and blue of all pixels.
    picture: (usize, Vec<[u8; 3]>),
}

fn open(chromium: &str, folder: &Path, page: &str) -> Seen {
    let profile = tempfile::tempdir().unwrap();
    let shot = folder.join("shot.png");
    let output = Command::new(chromium)
        .args("--headless --no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader".split(' '))
        .args("--enable-unsafe-swiftshader --disable-quic --no-first-run --disable-sync".split(' '))
        .args("--disable-background-networking --disable-component-update --enable-logging=stderr".split(' '))
        .args(["--window-size=900,600", "--virtual-time-budget=30000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--screenshot={}", shot.display()))
        .arg(format!("file://{}", folder.join(page).display()))
        .stdin(Stdio::null())
        .output()
        .expect("the browser starts");
    let reader = png::Decoder::new(BufReader::new(File::open(&shot).expect("a picture"))).read_info();
    let mut reader = reader.unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let samples = info.color_type.samples();
    let dots = bytes[..info.buffer_size()].chunks_exact(samples).map(|d| [d[0], d[1], d[2]]).collect();
    Seen {
        document: text(&output.stdout),
        messages: text(&output.stderr),
        picture: (info.width as usize, dots),
    }
}

impl Seen {
    /// Asserts that the page is ready, shows that many points, and reports no error.
    fn check(&self, points: usize) {
        let root = self.document.lines().find(|line| line.contains("<html")).unwrap_or_default();
        assert!(root.contains("data-state=\"ready\""), "{root}\n{}", self.messages);
        assert!(root.contains(&format!("data-points=\"{points}\"")), "{root}");
        // Messages of the browser about graphics are ignored; errors of the page are not.
        for line in self.messages.lines().filter(|line| line.contains("CONSOLE")) {
            assert!(!line.contains("ERROR") && !line.contains("Uncaught"), "{line}");
        }
    }

    /// Different colours, and the share of dots unlike the ground, in the middle of the window, clear of the
    /// panels.
    fn middle(&self) -> (usize, f64) {
        let (width, dots) = &self.picture;
        let ground = dots[dots.len() - width / 2];
        let inside = |i: &usize| (width / 3..width * 2 / 3).contains(&(i % width));
        let middle: Vec<[u8; 3]> = (0..dots.len()).filter(inside).map(|i| dots[i]).collect();
        let drawn = middle.iter().filter(|dot| **dot != ground).count();
        (middle.iter().collect::<HashSet<_>>().len(), drawn as f64 / middle.len() as f64)
    }
}

#[test]
fn a_browser_shows_the_points_without_a_complaint() {
    let Some(chromium) = chromium() else { return };
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    succeed(dir.path(), &[survey.to_str().unwrap(), "-o", "forest.laz", "-q"]);
    let said = text(&succeed(dir.path(), &["preview", "forest.laz", "-o", "forest.html"]).stderr);
    assert!(said.contains("forest.html") && said.contains("points; open it in a browser"), "{said}");
    succeed(
        dir.path(),
        &["preview", "forest.laz", "-o", "few.html", "--colour", "class", "--max-points", "5000"],
    );
    let page = std::fs::read_to_string(dir.path().join("few.html")).unwrap();
    assert!(page.contains("5 000 of "), "the page says that it shows a sample");

    let all = std::fs::read_to_string(dir.path().join("forest.html")).unwrap();
    let blocks = all.split("data-count=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
    let points: usize = blocks.map(|count| count.parse::<usize>().unwrap()).sum();
    assert!(points > 30_000, "{points}");
    for (page, points) in [("forest.html", points), ("few.html", 5000)] {
        let seen = open(&chromium, dir.path(), page);
        seen.check(points);
        let (colours, drawn) = seen.middle();
        assert!(colours > 40 && drawn > 0.15, "{page}: {colours} colours, {drawn} of the middle drawn");
    }
}

#[test]
fn keys_and_pointer_work() {
    let Some(chromium) = chromium() else { return };
    let dir = folder();
    let survey = fixture("room/survey.xml");
    succeed(dir.path(), &[survey.to_str().unwrap(), "-o", "room.xyz", "-q"]);
    succeed(dir.path(), &["preview", "room.xyz", "-o", "room.html", "-q"]);
    let path = dir.path().join("room.html");
    let page = std::fs::read_to_string(&path).unwrap();
    // A script that uses every control once and records the result.
    let visitor = r#"<script>
      const key = key => dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
      const canvas = document.getElementById('view');
      const point = (kind, x, y) => canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: y, buttons: 1, bubbles: true }));
      canvas.setPointerCapture = () => {};
      const visit = setInterval(() => {
        if (document.documentElement.dataset.state !== 'ready') return;
        clearInterval(visit);
        for (const k of ['ArrowLeft', '+', '-', '[', ']', 'o', 'e', 's', 't', '3']) key(k);
        const needle = () => document.getElementById('needle').getAttribute('transform');
        // The image is updated by the browser later.
        const once = (done, then) => { const wait = setInterval(() => { if (done()) { clearInterval(wait); then(); } }, 50); };
        const heading = () => Number(document.getElementById('needle').getAttribute('transform').slice(7, -1));
        once(() => heading() === 0, () => {
          point('pointerdown', 450, 300); point('pointermove', 500, 310); point('pointerup', 500, 310);
          canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -200, clientX: 450, clientY: 300 }));
          canvas.dispatchEvent(new MouseEvent('dblclick', { clientX: 450, clientY: 330 }));
          document.querySelector('#legend input').click();
          once(() => heading() !== 0, () => {
            const found = { colour: document.getElementById('colour').value, heading: heading(),
              named: document.getElementById('status').textContent, parallel: !document.getElementById('perspective').checked };
            document.body.dataset.found = JSON.stringify(found);
          });
        });
      }, 100);
    </script></body>"#;
    std::fs::write(&path, page.replace("</body>", visitor)).unwrap();
    // A browser on a busy machine may use up its time before the page is drawn: a second one is started then.
    let visited = |seen: &Seen| {
        let rest = seen.document.split("data-found=\"").nth(1)?;
        rest.split('"').next().map(str::to_owned)
    };
    let mut seen = open(&chromium, dir.path(), "room.html");
    if visited(&seen).is_none() {
        seen = open(&chromium, dir.path(), "room.html");
    }
    let found = visited(&seen);
    let found = found.unwrap_or_else(|| panic!("the visitor did not come to an end: {}", seen.messages));
    let found: serde_json::Value = serde_json::from_str(&found.replace("&quot;", "\"")).unwrap();
    assert_eq!((&found["colour"], &found["parallel"]), (&"class".into(), &true.into()));
    // 50 pixels to the right are 0.3 radians.
    let heading = found["heading"].as_f64().unwrap();
    assert!((heading + 0.3f64.to_degrees()).abs() < 1e-6, "{heading}");
    let named = found["named"].as_str().unwrap();
    assert!(named.starts_with("x ") && named.contains("return 1"), "{named:?}");
    assert!(!seen.document.contains("data-state=\"error\""), "{named}");
}

#[test]
fn a_name_that_tells_no_format_and_numbers_that_are_none_are_refused() {
    let dir = folder();
    std::fs::write(dir.path().join("a.xyz"), "1 2 3\n4 5 6\n").unwrap();
    for (args, expected) in [
        (&["preview", "a.xyz", "-o", "a.jpeg"][..], ".png, .html or .copc.laz"),
        (&["preview", "a.xyz", "-o", "a.html", "--max-points", "many"], "--max-points"),
        (&["preview", "a.xyz", "-o", "a.html", "--max-points", "0"], "--max-points"),
        // The option's earlier name.
        (&["preview", "a.xyz", "-o", "a.html", "--most-points", "0"], "--max-points"),
        (&["preview", "a.xyz", "-o", "a.xyz"], "exists already"),
        (&["preview", "a.xyz", "-o", "a.copc.laz", "--pulse", "1"], "no waveforms"),
        (&["scene", "map", "a.xyz", "-o", "a.jpeg"], ".png"),
    ] {
        let refused = run(dir.path(), args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(text(&refused.stderr).contains(expected), "{}", text(&refused.stderr));
    }
    for (args, unused) in [
        (&["-o", "b.html", "--width", "400", "--height", "300", "--light"][..], "--width, --height"),
        (&["-o", "b.png", "--max-points", "5", "--assets", "."], "--max-points, --assets"),
        (&["-o", "b.copc.laz", "--colour", "class"], "--colour"),
    ] {
        let said = text(&succeed(dir.path(), &[&["preview", "a.xyz"], args].concat()).stderr);
        assert!(said.contains(&format!("no effect on this output: {unused}\n")), "{args:?}: {said}");
    }
    // A picture goes to stdout, complete.
    let picture = succeed(dir.path(), &["preview", "a.xyz", "-o", "-", "-q"]).stdout;
    assert!(picture.starts_with(b"\x89PNG") && picture.ends_with(b"IEND\xaeB`\x82"));
}

#[test]
fn a_plan_is_drawn_by_flight_lines() {
    let dir = folder();
    let corners = ["-400 -400", "400 -400", "400 400", "-400 400"].map(|corner| format!("v {corner} 0\n"));
    std::fs::write(dir.path().join("flat.obj"), corners.concat() + "f 1 2 3\nf 1 3 4\n").unwrap();
    let area = "POLYGON ((-200 -200, 200 -200, 200 200, -200 200))";
    let plan = ["plan", "airborne", "--scanner", "riegl_vux-1uav", "--platform", "quadcopter"];
    let size = ["--scene", "flat.obj", "--area", area, "--height", "80", "--density", "30", "-q"];
    succeed(dir.path(), &[&plan[..], &size, &["-o", "plan.toml"]].concat());
    let plan = std::fs::read_to_string(dir.path().join("plan.toml")).unwrap();
    let strips: HashSet<&str> = plan.lines().filter(|line| line.starts_with("strip = ")).collect();
    assert!(strips.len() > 2, "{plan}");
    succeed(dir.path(), &["preview", "plan.toml", "-o", "plan.html", "-q"]);
    let page = std::fs::read_to_string(dir.path().join("plan.html")).unwrap();
    let is_named = |number: usize| page.contains(&format!("\"line {number}\""));
    assert!((1..=strips.len()).all(is_named) && !is_named(strips.len() + 1), "{} lines", strips.len());
    for (name, light) in [("dark.png", None), ("light.png", Some("--light"))] {
        let args = ["preview", "plan.toml", "-o", name, "--width", "800", "--height", "600", "-q"];
        succeed(dir.path(), &[&args[..], light.as_slice()].concat());
        let file = BufReader::new(File::open(dir.path().join(name)).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height), (800, 600));
        let colours: HashSet<&[u8]> = bytes.chunks_exact(3).collect();
        assert!(colours.len() > strips.len(), "{name}: {} colours", colours.len());
    }
}

#[test]
fn a_waveform_is_plotted_with_the_echoes_that_the_run_found() {
    let dir = folder();
    let survey = fixture("forest/survey.xml");
    let survey = survey.to_str().unwrap();
    for zip in [&[][..], &["--zip-output"]] {
        succeed(
            dir.path(),
            &[
                &[
                    "run",
                    survey,
                    "--physics",
                    "refined",
                    "--output",
                    "out",
                    "--waveforms",
                    "--echo-width",
                    "-q",
                ],
                zip,
            ]
            .concat(),
        );
    }
    let find = |ending: &str| {
        let found =
            files(&dir.path().join("out")).into_iter().find(|f| f.to_str().unwrap().ends_with(ending));
        dir.path().join("out").join(found.unwrap_or_else(|| panic!("no {ending}"))).display().to_string()
    };
    let points = std::fs::read_to_string(find("001_points.xyz")).unwrap();
    let only = points.lines().map(|l| l.split(' ').collect::<Vec<_>>()).find(|p| p[6] == "1").unwrap();
    let pulse = only[7];
    let wave = find("001_fullwave.txt");
    succeed(dir.path(), &["preview", &wave, "--pulse", pulse, "-o", "wave.html", "-q"]);
    let page = std::fs::read_to_string(dir.path().join("wave.html")).unwrap();
    let width: f64 = only[4].parse().unwrap();
    assert!(page.contains(&format!("fit: {width:.2} ns")), "{width} in {page}");
    assert!(page.contains("echo 1: range ") && !page.contains("echo 2"), "{page}");

    let packed = find("001_fullwave.bin");
    succeed(dir.path(), &["preview", &packed, "--pulse", pulse, "-o", "packed.png", "-q"]);
    succeed(dir.path(), &["preview", &wave, "--pulse", pulse, "-o", "wave.png", "-q"]);
    let picture = std::fs::read(dir.path().join("wave.png")).unwrap();
    assert!(picture.len() > 5000 && picture.starts_with(b"\x89PNG"), "{} bytes", picture.len());
    let text = std::fs::read(&wave).unwrap();
    let piped = common::feed(dir.path(), &["preview", "-", "--pulse", pulse, "-o", "-", "-q"], &text);
    assert!(piped.status.success() && piped.stdout.starts_with(b"\x89PNG"));
    let refused = run(dir.path(), &["preview", &wave, "--pulse", "99999999", "-o", "none.png"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(common::text(&refused.stderr).contains("; nearest: "), "{}", common::text(&refused.stderr));
}
