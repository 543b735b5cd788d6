//! The live page as a browser gets it.

use crate::common::{LIMIT, datagrams, received, schema, shape, wait_for};
use eit_publish::{Publisher, Recording, SkinImage, WebServer};
use eit_skin::ndarray::array;
use eit_skin::{SkinState, TouchFrame};
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A server on the loopback interface, and its address.
fn server() -> (WebServer, String) {
    let server = WebServer::new("127.0.0.1:0").unwrap();
    let address = address(&server);
    (server, address)
}

fn address(server: &WebServer) -> String {
    let url = server.url();
    url.trim_start_matches("http://").split('/').next().unwrap().to_owned()
}

/// What a page has to know.
fn token(server: &WebServer) -> String {
    server.url().split_once("?token=").unwrap().1.to_owned()
}

fn ask(address: &str, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    stream
}

/// The whole answer to a request, which has this status.
fn answer(address: &str, request: &str, status: u16) -> String {
    let mut text = String::new();
    ask(address, request).read_to_string(&mut text).unwrap();
    assert!(text.starts_with(&format!("HTTP/1.1 {status} ")), "{request:?}: {text}");
    text
}

/// Asks for the events of a page.
fn events(address: &str) -> BufReader<TcpStream> {
    BufReader::new(ask(address, &get("/events", address)))
}

fn get(path: &str, host: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n")
}

fn frame(sequence: u64) -> TouchFrame<'static> {
    crate::common::frame(sequence, &[], &[])
}

/// The next event of a page, heartbeats aside.
fn event(from: &mut BufReader<TcpStream>) -> Value {
    loop {
        let mut line = String::new();
        assert!(from.read_line(&mut line).unwrap() > 0, "the stream has ended");
        if let Some(data) = line.strip_prefix("data: ") {
            let event: Value = serde_json::from_str(data).unwrap();
            if event["type"] != "still" {
                return event;
            }
        }
    }
}

#[test]
fn the_page_needs_nothing_else_and_refuses_strangers() {
    let (_server, address) = server();
    let page = answer(&address, &get("/", &address), 200);
    assert!(page.contains("default-src 'none'"), "{page}");
    let (head, body) = page.split_once("\r\n\r\n").unwrap();
    assert!(head.ends_with(&format!("Content-Length: {}", body.len())), "{head}");
    assert!(body.ends_with("</html>\n"));
    for elsewhere in ["http:", "https:", "src=", "href=", "@import", "url("] {
        assert!(!body.contains(elsewhere), "the page loads something: {elsewhere}");
    }
    for (request, status) in [
        (get("/", "evil.example"), 403),
        (get("/events", "evil.example"), 403),
        (get("/../etc/passwd", "localhost"), 404),
        ("POST / HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned(), 405),
        ("nonsense\r\n\r\n".to_owned(), 400),
    ] {
        answer(&address, &request, status);
    }
}

#[test]
fn beyond_loopback_a_token_is_asked_for() {
    let server = WebServer::new("0.0.0.0:0").unwrap();
    let token = token(&server);
    assert_eq!(token.len(), 32);
    assert_ne!(self::token(&WebServer::new("0.0.0.0:0").unwrap()), token);
    // an address that a phone can open, unless this computer has no network
    let local = address(&server).replace("0.0.0.0", "127.0.0.1");
    for (path, status) in [("/", 403), ("/events", 403), (&format!("/?token={token}"), 200)] {
        answer(&local, &get(path, "robot"), status);
    }
}

#[test]
fn a_page_hears_of_the_skin_its_frames_and_images() {
    let (server, address) = server();
    let mut publisher = Publisher::new().with_web(server);
    publisher.skin(&shape()).unwrap();
    assert!(!publisher.wants_image(), "nobody looks");
    let mut page = events(&address);
    let skin = event(&mut page);
    assert_eq!((&skin["type"], &skin["electrodes_m"][0][1][0]), (&"skin".into(), &json!(0.01)));
    // who comes before the first frame hears what is waited for, who comes later does not
    publisher.waiting(3).unwrap();
    let mut early = events(&address);
    assert_eq!(event(&mut early)["type"], "skin");
    assert_eq!(event(&mut early)["event"], "reference_started");
    assert_eq!(event(&mut page)["event"], "reference_started");
    publisher.waiting(0).unwrap();
    assert_eq!(event(&mut page)["event"], "reference_taken");
    publisher.touches(&frame(7)).unwrap();
    let mut late = events(&address);
    assert_eq!(event(&mut late)["type"], "skin");
    std::thread::sleep(Duration::from_millis(200));
    publisher.touches(&frame(8)).unwrap();
    assert_eq!(event(&mut late)["sequence"], 8);
    let line = event(&mut page);
    let schema = schema();
    assert!(schema.is_valid(&line) && line["sequence"] == 7, "{line}");
    // frames that follow at once are more than an eye sees; events are not left out
    (0..100).for_each(|sequence| publisher.touches(&frame(sequence)).unwrap());
    publisher.waiting(9).unwrap();
    let mut next = event(&mut page);
    while next["type"] != "event" {
        assert!(schema.is_valid(&next), "{next}");
        next = event(&mut page);
    }
    assert_eq!(next["event"], "reference_started");
    assert!(publisher.wants_image());
    publisher.image(array![[f64::NAN, 2e-6], [-1e-6, 0.0]].view()).unwrap();
    let wanted = json!({
        "type": "image", "rows": 2, "columns": 2, "range_s": 2e-6, "pixels": "AP9AgA==",
        "raw": null, "faintest_s": 0.0, "gap": null,
    });
    assert_eq!(event(&mut page), wanted);
    let (change, before) = (array![[1e-6, 0.0]], array![[-4e-6, f64::NAN]]);
    let (before_net_s, gap) = (Some(before.view()), Some(0.02));
    let both = SkinImage { before_net_s, gap, faintest_s: 3e-7, ..change.view().into() };
    publisher.image(both).unwrap();
    let image = event(&mut page);
    assert_eq!(image["raw"], json!({ "range_s": 4e-6, "pixels": "AQA=" }));
    assert_eq!((&image["faintest_s"], &image["gap"]), (&json!(3e-7), &json!(0.02)));
    drop(publisher);
    let mut rest = String::new();
    page.read_to_string(&mut rest).unwrap();
    assert_eq!(rest.trim(), "", "the end of the stream");
}

/// A frozen instrument and the end are said in lines, datagrams and on the page, also beyond the 30 frames a second that it shows.
#[test]
fn what_is_known_of_the_skin_is_said_in_every_output() {
    let (server, address) = server();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lines");
    let (receiver, udp) = datagrams();
    let publisher = Publisher::new().with_web(server).with_udp(udp);
    let mut publisher = publisher.with_lines(std::fs::File::create(&path).unwrap()).unwrap();
    publisher.skin(&shape()).unwrap();
    let mut page = events(&address);
    assert_eq!(event(&mut page)["type"], "skin");
    let states = [SkinState::Sound, SkinState::NotExplained, SkinState::Frozen, SkinState::NoData];
    for (state, sequence) in states.into_iter().zip(1..) {
        publisher.touches(&TouchFrame { state, ..frame(sequence) }).unwrap();
    }
    publisher.end().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for (line, state) in lines.iter().zip(states) {
        assert_eq!(line["state"], state.name());
        assert_eq!(line["explained"], state == SkinState::Sound);
        assert_eq!(line["frozen"], state == SkinState::Frozen);
        assert_eq!((&received(&receiver), &event(&mut page)), (line, line));
    }
    assert_eq!(lines.len(), 5, "{text}");
    assert_eq!((&lines[4]["event"], &lines[4]["frames"]), (&json!("ended"), &json!(3)));
}

/// The page records for whoever knows the token, also on this computer: a foreign page could send the request, too.
#[test]
fn recordings_are_asked_for_with_the_token_only() {
    let server = WebServer::with_recording("127.0.0.1:0").unwrap();
    let (address, token) = (address(&server), token(&server));
    let publisher = Publisher::new().with_web(server);
    publisher.recording(Recording::Off { file: None }).unwrap();
    let post = |path: &str, host: &str| {
        format!("POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 0\r\n\r\n")
    };
    // the page itself needs no token here
    answer(&address, &get("/", &address), 200);
    for (path, host, status) in [
        ("/record/start".to_owned(), address.as_str(), 403),
        (format!("/record/start?token={}", "0".repeat(32)), address.as_str(), 403),
        (format!("/record/start?token={token}"), "evil.example", 403),
        (format!("/record?token={token}"), address.as_str(), 405),
    ] {
        answer(&address, &post(&path, host), status);
        assert_eq!(publisher.recording_request(), None, "{path}");
    }
    for (path, wanted) in [("start", true), ("stop", false)] {
        answer(&address, &post(&format!("/record/{path}?token={token}"), &address), 202);
        assert_eq!(publisher.recording_request(), Some(wanted));
        assert_eq!(publisher.recording_request(), None, "taken once");
    }
    publisher.recording(Recording::On { file: "skin.mcap", can_stop: true }).unwrap();
    // a page that opens now hears the state
    let mut page = events(&address);
    let on = json!({ "type": "recording", "state": "on", "file": "skin.mcap", "can_stop": true });
    assert_eq!(event(&mut page), on);
    publisher.recording(Recording::Failed { error: "disk full" }).unwrap();
    assert_eq!(event(&mut page)["error"], "disk full");

    // where nothing can be recorded, the page does not offer it
    let (server, other) = self::server();
    assert!(!server.url().contains("token"));
    answer(&other, &post("/record/start", &other), 404);
}

/// A browser that does not read, and many of them, hold nothing up. Those that have gone leave their places to others, also
/// while nothing is said to them.
#[test]
fn slow_browsers_miss_lines_and_too_many_are_refused() {
    let (server, address) = server();
    let mut publisher = Publisher::new().with_web(server);
    assert!(!publisher.has_viewer(), "nobody looks");
    let browsers = || -> Vec<BufReader<TcpStream>> {
        let mut browsers: Vec<_> = (0..16).map(|_| events(&address)).collect();
        // its answer begins once it has a place
        browsers.iter_mut().for_each(|browser| browser.read_exact(&mut [0]).unwrap());
        browsers
    };
    let status_of_another = || {
        let mut start = [0; 12];
        events(&address).read_exact(&mut start).unwrap();
        String::from_utf8_lossy(&start[9..]).into_owned()
    };
    let open = browsers();
    assert!(status_of_another() == "503" && publisher.has_viewer());
    drop(open);
    // far below the five seconds after which a browser hears that the program is still there
    let start = Instant::now();
    wait_for("the places are not free", || !publisher.has_viewer());
    assert!(start.elapsed() < Duration::from_secs(3), "{:?}", start.elapsed());
    assert_eq!(status_of_another(), "200");
    wait_for("the place is not free", || !publisher.has_viewer());
    let idle = browsers();
    let start = Instant::now();
    // events are not thinned: 16 MB that nobody reads
    (0..10_000).for_each(|_| publisher.waiting(0).unwrap());
    assert!(start.elapsed() < LIMIT, "{:?}", start.elapsed());
    drop(idle);
}

/// A request that trickles in is given up after five seconds, not five seconds after its last byte; and who asks
/// without end gets a bounded number of connections.
#[test]
fn who_asks_slowly_or_too_often_is_closed() {
    let (_server, address) = server();
    let mut slow: Vec<_> = (0..64).map(|_| ask(&address, "GET /events HTTP/1.1\r\n")).collect();
    let start = Instant::now();
    // the sixty-fifth is closed unheard
    let ended = ask(&address, "").read(&mut [0]).map_or(true, |bytes| bytes == 0);
    assert!(ended && start.elapsed() < Duration::from_secs(4), "{:?}", start.elapsed());
    let slowest = slow.last_mut().unwrap();
    slowest.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
    let is_closed = loop {
        assert!(start.elapsed() < LIMIT, "a request that trickles is waited for");
        let wrote = slowest.write_all(b"A");
        match slowest.read(&mut [0]) {
            Ok(0) => break true,
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock && wrote.is_ok() => {}
            answered => break answered.is_err(),
        }
    };
    assert!(is_closed && start.elapsed() < Duration::from_secs(9), "{:?}", start.elapsed());
    // their places are free again
    wait_for("the page is not served any more", || {
        let mut stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let mut text = [0; 12];
        let page = get("/", &address);
        let asked = stream.write_all(page.as_bytes()).and_then(|()| stream.read_exact(&mut text));
        asked.is_ok() && &text == b"HTTP/1.1 200"
    });
}
