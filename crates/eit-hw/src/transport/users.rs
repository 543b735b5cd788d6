//! Other programs that have a port open: each byte that arrives goes to one of them.

use super::endpoint::Endpoint;

impl Endpoint {
    /// Names the other programs on this computer that have the port open, as far as the system tells this user (Linux); empty for
    /// none. An emulated board on a pseudo-terminal may have its own end open.
    pub(crate) fn other_users(&self) -> Vec<String> {
        match self {
            Self::Serial { path, .. } => of_file(path),
            Self::Tcp { .. } => Vec::new(),
        }
    }
}

#[cfg(target_os = "linux")]
fn of_file(path: &str) -> Vec<String> {
    use std::fs;
    let Ok(file) = fs::canonicalize(path) else { return Vec::new() };
    let own = std::process::id().to_string();
    let programs = fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = programs.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let others = numbers.filter(|number| number.parse::<u32>().is_ok() && *number != own);
    let has_open = |number: &String| {
        let files = fs::read_dir(format!("/proc/{number}/fd")).into_iter().flatten().flatten();
        files.flat_map(|entry| fs::read_link(entry.path())).any(|target| target == file)
    };
    let name = |number: String| {
        let name = fs::read_to_string(format!("/proc/{number}/comm")).unwrap_or_default();
        format!("{} (process {number})", name.trim())
    };
    others.filter(has_open).map(name).collect()
}

#[cfg(not(target_os = "linux"))]
fn of_file(_: &str) -> Vec<String> {
    Vec::new()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_has_the_port_open_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path().to_str().unwrap().to_owned();
        let endpoint = Endpoint::Serial { path: path.clone(), baud: 9600, dtr: None };
        // not by itself
        assert_eq!(endpoint.other_users(), Vec::<String>::new());
        let opened = std::fs::File::open(&path).unwrap();
        let mut other =
            std::process::Command::new("sleep").arg("60").stdin(opened).spawn().unwrap();
        let found = endpoint.other_users();
        let _ = other.kill();
        let _ = other.wait();
        assert_eq!(found, [format!("sleep (process {})", other.id())]);
    }
}
