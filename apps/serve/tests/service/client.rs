//! Starting the service, and asking it.

use serde_json::Value;
use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for a job.
const PATIENCE: Duration = Duration::from_secs(300);

/// The program vlscan beside the tests.
pub fn vlscan() -> PathBuf {
    let own = std::env::current_exe().unwrap();
    let program = own.ancestors().nth(2).unwrap().join("vlscan");
    assert!(program.is_file(), "these tests need the program vlscan: `cargo build` makes it");
    program
}

/// Files of the project's fixtures.
pub fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures")
}

/// Starts a service that ends at once, without success. Returns its messages.
pub fn refused(data: &Path, options: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vlscan-serve"));
    command.args(["--listen", "127.0.0.1:0", "--program"]).arg(vlscan()).arg("--data").arg(data);
    let done = command.args(options).output().unwrap();
    assert!(!done.status.success(), "{options:?}");
    String::from_utf8_lossy(&done.stderr).into_owned()
}

/// A service that runs.
pub struct Service {
    process: Child,
    pub address: String,
    pub data: PathBuf,
    options: Vec<String>,
    token: Option<String>,
    _folder: Option<tempfile::TempDir>,
}

impl Service {
    /// Starts a service with these options in a folder of its own.
    pub fn start(options: &[&str]) -> Service {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        let mut service = Service::of(&data, options, None);
        service._folder = Some(folder);
        service
    }

    /// Starts a service that asks for this token.
    pub fn with_token(options: &[&str], token: &str) -> Service {
        let folder = tempfile::tempdir().unwrap();
        let mut service = Service::of(&folder.path().join("data"), options, Some(token));
        service._folder = Some(folder);
        service
    }

    /// Starts a service in this folder.
    pub fn at(data: &Path, options: &[&str]) -> Service {
        Service::of(data, options, None)
    }

    fn of(data: &Path, options: &[&str], token: Option<&str>) -> Service {
        Service::by(Command::new(env!("CARGO_BIN_EXE_vlscan-serve")), data, options, token)
    }

    /// Starts a service by a command, to which the options are added.
    pub fn by(mut command: Command, data: &Path, options: &[&str], token: Option<&str>) -> Service {
        if !options.iter().any(|option| option.starts_with("--program=")) {
            command.arg("--program").arg(vlscan());
        }
        command.args(["--listen", "127.0.0.1:0", "--data"]).arg(data).args(options);
        command.env_remove("VLSCAN_TOKEN").stdin(Stdio::null()).stderr(Stdio::piped());
        if let Some(token) = token {
            command.env("VLSCAN_TOKEN", token);
        }
        let mut process = command.spawn().unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap());
        let mut said = String::new();
        let address = loop {
            let mut line = String::new();
            assert!(lines.read_line(&mut line).unwrap() > 0, "the service ended: {said}");
            said += &line;
            if let Some((_, rest)) = line.split_once("http://") {
                break rest.split('/').next().unwrap().to_owned();
            }
        };
        // What it says later is shown with the test.
        std::thread::spawn(move || lines.lines().map_while(Result::ok).for_each(|line| println!("{line}")));
        let options = options.iter().map(|option| (*option).to_owned()).collect();
        Service {
            process,
            address,
            data: data.to_owned(),
            options,
            token: token.map(str::to_owned),
            _folder: None,
        }
    }

    /// Sends the service a signal.
    pub fn signal(&self, name: &str) {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
    }

    /// Kills the service.
    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Ends the service, as its operator does.
    pub fn stop(&mut self) {
        self.signal("TERM");
        assert!(self.process.wait().unwrap().success());
    }

    /// Kills the service, if it runs, and starts another one in the same folder.
    pub fn restart(&mut self) {
        let _ = self.process.kill();
        self.process.wait().unwrap();
        let options: Vec<&str> = self.options.iter().map(String::as_str).collect();
        let mut next = Service::of(&self.data, &options, self.token.as_deref());
        std::mem::swap(&mut self.process, &mut next.process);
        self.address.clone_from(&next.address);
    }

    /// Its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Asks, with a body of a type.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut request =
            format!("{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n", self.address);
        if let Some(token) = &self.token {
            let _ = write!(request, "Authorization: Bearer {token}\r\n");
        }
        self.ask_raw(request, headers, body)
    }

    /// Asks without a token.
    pub fn ask_stranger(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let is_named = headers.iter().any(|(name, _)| *name == "Host");
        let host = if is_named { String::new() } else { format!("Host: {}\r\n", self.address) };
        self.ask_raw(format!("{method} {path} HTTP/1.1\r\n{host}Connection: close\r\n"), headers, body)
    }

    fn ask_raw(&self, mut request: String, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        for (name, value) in headers {
            let _ = write!(request, "{name}: {value}\r\n");
        }
        let _ = write!(request, "Content-Length: {}\r\n\r\n", body.len());
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        // A body that is refused may not be taken to its end.
        let _ = stream.write_all(body);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        Answer::of(&bytes)
    }

    pub fn get(&self, path: &str) -> Answer {
        self.ask("GET", path, &[], b"")
    }

    /// JSON of an address.
    pub fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", answer.text());
        answer.json()
    }

    pub fn post_json(&self, path: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
        let headers = [&[("Content-Type", "application/json")], headers].concat();
        self.ask("POST", path, &headers, body.to_string().as_bytes())
    }

    /// Executes a process with inputs; returns the answer.
    pub fn execute(&self, process: &str, inputs: &Value) -> Answer {
        self.post_json(
            &format!("/processes/{process}/execution"),
            &serde_json::json!({ "inputs": inputs, "response": "document" }),
            &[],
        )
    }

    /// Executes a process as a job and waits for its end.
    pub fn run(&self, process: &str, inputs: &Value) -> Value {
        let id = self.submit(process, inputs);
        self.wait(&id)
    }

    /// Adds a job.
    pub fn submit(&self, process: &str, inputs: &Value) -> String {
        let path = format!("/processes/{process}/execution");
        let request = serde_json::json!({ "inputs": inputs, "response": "document" });
        let answer = self.post_json(&path, &request, &[("Prefer", "respond-async")]);
        assert_eq!(answer.status, 201, "{}", answer.text());
        answer.json()["jobID"].as_str().unwrap().to_owned()
    }

    /// Waits until a job is finished; returns its state.
    pub fn wait(&self, id: &str) -> Value {
        let start = Instant::now();
        loop {
            let job = self.json(&format!("/jobs/{id}"));
            if !matches!(job["status"].as_str().unwrap(), "accepted" | "running") {
                return job;
            }
            assert!(start.elapsed() < PATIENCE, "{job}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits until there are no incomplete files. The service writes its clock at its start and now and then,
    /// first to a file among them.
    pub fn wait_until_incoming_is_empty(&self, why: &str) {
        let start = Instant::now();
        while std::fs::read_dir(self.data.join("incoming")).unwrap().count() > 0 {
            assert!(start.elapsed() < Duration::from_secs(60), "{why}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Uploads files under a name.
    pub fn upload(&self, name: &str, files: &[(&str, Vec<u8>)]) -> Answer {
        self.upload_with(name, files, &[])
    }

    /// Uploads files with further headers.
    pub fn upload_with(&self, name: &str, files: &[(&str, Vec<u8>)], headers: &[(&str, &str)]) -> Answer {
        let (media, body) = form(name, files);
        let headers = [&[("Content-Type", media.as_str())], headers].concat();
        self.ask("POST", "/uploads", &headers, &body)
    }

    /// Uploads a folder of the fixtures.
    pub fn upload_fixture(&self, name: &str) {
        let answer = self.upload(name, &files_of(&fixtures().join(name)));
        assert_eq!(answer.status, 201, "{}", answer.text());
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The files of a folder.
pub fn files_of(folder: &Path) -> Vec<(&'static str, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| {
            let name: &'static str = Box::leak(entry.file_name().into_string().unwrap().into_boxed_str());
            (name, std::fs::read(entry.path()).unwrap())
        })
        .collect();
    files.sort();
    files
}

/// A form with files: its media type and body.
pub fn form(name: &str, files: &[(&str, Vec<u8>)]) -> (String, Vec<u8>) {
    let boundary = "a-boundary-that-no-file-has";
    let mut body = Vec::new();
    if !name.is_empty() {
        body.extend(
            format!("--{boundary}\r\nContent-Disposition: form-data; name=\"name\"\r\n\r\n{name}\r\n")
                .bytes(),
        );
    }
    for (file, content) in files {
        body.extend(
            format!(
                "--{boundary}\r\nContent-Disposition: form-data; name=\"file\"; filename=\"{file}\"\r\n\r\n"
            )
            .bytes(),
        );
        body.extend(content);
        body.extend(b"\r\n");
    }
    body.extend(format!("--{boundary}--\r\n").bytes());
    (format!("multipart/form-data; boundary={boundary}"), body)
}

/// An answer of the service.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

impl Answer {
    fn of(bytes: &[u8]) -> Answer {
        let end = bytes
            .windows(4)
            .position(|window| window == b"\r\n\r\n")
            .unwrap_or_else(|| panic!("no answer: {:?}", String::from_utf8_lossy(bytes)));
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let mut lines = head.lines();
        let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
        let headers: Vec<(String, String)> = lines
            .filter_map(|line| line.split_once(": "))
            .map(|(name, value)| (name.to_lowercase(), value.to_owned()))
            .collect();
        let body = bytes[end + 4..].to_vec();
        let is_chunked =
            headers.iter().any(|(name, value)| name == "transfer-encoding" && value == "chunked");
        Answer { status, headers, body: if is_chunked { unchunked(&body) } else { body } }
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(known, _)| known == name).map_or("", |(_, value)| value)
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }
}

fn unchunked(mut rest: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    while let Some(at) = rest.windows(2).position(|window| window == b"\r\n") {
        let length = usize::from_str_radix(std::str::from_utf8(&rest[..at]).unwrap().trim(), 16).unwrap();
        if length == 0 || rest.len() < at + 2 + length {
            break;
        }
        body.extend(&rest[at + 2..at + 2 + length]);
        rest = &rest[(at + 4 + length).min(rest.len())..];
    }
    body
}
