//! Examples, uploads from pages, forms that are shown again with a fix, and the way through the jobs of a scan.

use super::browser::{finished, page, send, token_of};
use crate::client::{Service, form};

const HTML: (&str, &str) = ("Accept", "text/html");

#[test]
fn examples_are_scanned_by_one_click() {
    let service = Service::start(&[]);
    let home = page(&service, "/");
    let token = token_of(&home).to_owned();
    for (example, upload) in [("forest", "example-forest"), ("terrain", "example-terrain")] {
        assert!(home.contains(&format!("name=\"example\" value=\"{example}\"")), "{home}");
        let begun = send(&service, "/forms/example", &token, &[("example", example)]);
        assert_eq!(begun.status, 303, "{}", begun.text());
        let done = finished(&service, begun.header("location"));
        assert!(done.contains("/results/points.copc.laz\""), "{done}");
        assert!(page(&service, &format!("/uploads/{upload}")).contains(upload));
        // The second click uses the same upload, and the results that there are.
        let again = send(&service, "/forms/example", &token, &[("example", example)]);
        assert_eq!(service.json(again.header("location"))["status"], "successful");
    }
    assert_eq!(service.json("/uploads")["uploads"].as_array().unwrap().len(), 2);
    assert!(!page(&service, "/").contains("/forms/example"), "examples are for empty pages");
    assert_eq!(send(&service, "/forms/example", &token, &[("example", "sea")]).status, 400);
}

#[test]
fn uploads_of_pages_get_a_number_and_keep_their_form() {
    let service = Service::start(&["--workers", "0"]);
    let (media, body) = form("plot", &[("a.obj", b"v 0 0 0\n".to_vec())]);
    let numbered = |text: &[u8]| {
        let field = "Content-Disposition: form-data; name=\"taken\"\r\n\r\nnumber\r\n";
        let boundary = media.split_once("boundary=").unwrap().1;
        [format!("--{boundary}\r\n{field}").as_bytes(), text].concat()
    };
    for expected in ["/uploads/plot", "/uploads/plot-2", "/uploads/plot-3"] {
        let answer = service.ask("POST", "/uploads", &[HTML, ("Content-Type", &media)], &numbered(&body));
        assert_eq!((answer.status, answer.header("location")), (303, expected));
    }
    // Programs choose names themselves.
    assert_eq!(service.ask("POST", "/uploads", &[("Content-Type", &media)], &body).status, 409);
    let (media, body) = form("none", &[]);
    let failed = service.ask("POST", "/uploads", &[HTML, ("Content-Type", &media)], &body);
    let text = failed.text();
    assert_eq!(failed.status, 400);
    assert!(text.contains("the upload has no files") && text.contains("action=\"/uploads\""), "{text}");
}
