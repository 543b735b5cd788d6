//! Advice for a port that cannot be opened.

use std::io::{self, ErrorKind};
use std::path::Path;

use super::endpoint::Endpoint;

/// Returns what to try, in words.
pub(super) fn advice(endpoint: &Endpoint, error: &io::Error) -> String {
    let path = match endpoint {
        Endpoint::Tcp { .. } => return "check the address, and that the instrument is on".into(),
        Endpoint::Serial { path, .. } => Path::new(path),
    };
    match error.kind() {
        ErrorKind::Unsupported => "build eit-hw with its feature `serial`".into(),
        ErrorKind::PermissionDenied => match group(path).filter(|group| !is_root(group)) {
            Some(group) => format!(
                "let your user use serial ports: it must be in the group `{group}` (`sudo usermod \
                 -aG {group} $USER`, then log in again)"
            ),
            None => "ask the administrator to let your user use this port, by a udev rule that gives it \
                     to a group for serial ports"
                .into(),
        },
        // the library reports "not found" for a port that another program has locked
        ErrorKind::NotFound | ErrorKind::ResourceBusy if path.exists() => {
            "another program uses the port: close it (on Linux, `fuser PORT` shows which)".into()
        }
        ErrorKind::NotFound => "plug it in, or name another port (`eit check` lists them)".into(),
        _ => "check that it is a serial port (`eit check` lists them)".into(),
    }
}

/// Returns the name of the group that owns a port, or its number if it has no name.
#[cfg(unix)]
fn group(path: &Path) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    let number = std::fs::metadata(path).ok()?.gid().to_string();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let named = groups.lines().find_map(|line| {
        // name:password:number:members
        let mut fields = line.split(':');
        let (name, found) = (fields.next()?, fields.nth(1)?);
        (found == number).then(|| name.to_owned())
    });
    named.or(Some(number))
}

/// Returns whether this is an administrators' group: joining it is no way to use a port.
fn is_root(group: &str) -> bool {
    ["root", "wheel", "0"].contains(&group)
}

#[cfg(not(unix))]
fn group(_: &Path) -> Option<String> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(path: &str, kind: ErrorKind) -> String {
        let endpoint = Endpoint::Serial { path: path.into(), baud: 9600, dtr: None };
        advice(&endpoint, &io::Error::from(kind))
    }

    #[test]
    fn a_busy_port_is_not_a_missing_one() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path().to_str().unwrap();
        assert!(of(path, ErrorKind::NotFound).contains("another program"));
        assert!(of("/nowhere/tty", ErrorKind::NotFound).starts_with("plug it in"));
        assert!(of(path, ErrorKind::Other).starts_with("check that it is a serial port"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn no_permission_names_the_group_but_never_that_of_root() {
        // group 0 is `root` on every Linux
        let message = of("/dev/null", ErrorKind::PermissionDenied);
        assert!(!message.contains("usermod") && message.contains("udev"), "{message}");
        assert!(is_root("root") && !is_root("dialout"));
    }
}
