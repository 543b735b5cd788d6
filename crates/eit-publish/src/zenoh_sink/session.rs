//! The zenoh session.

use crate::error::PublishError;
use std::path::PathBuf;
use zenoh::{Config, Session, Wait as _};

/// Router of ROS 2's `rmw_zenoh` on this computer.
const ROUTER: &str = "tcp/localhost:7447";
/// Any free port of this computer.
const ANY_PORT: &str = "tcp/127.0.0.1:0";
/// Variable that names the configuration file of all nodes that use `rmw_zenoh`.
const CONFIG: &str = "ZENOH_SESSION_CONFIG_URI";

/// How to open a zenoh session.
///
/// By default it connects to the router that `rmw_zenoh` uses, `tcp/localhost:7447`, retrying until it is
/// there, and listens on the loopback interface only. Multicast discovery is off.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SessionSettings {
    /// Endpoints to connect to, such as `tcp/192.168.1.2:7447`.
    pub connect: Vec<String>,
    /// Endpoints to listen at, such as `tcp/0.0.0.0:7460`.
    pub listen: Vec<String>,
    /// A configuration file of zenoh (JSON5) to begin with; `None` for that of the variable `ZENOH_SESSION_CONFIG_URI`, if it is
    /// set, as for ROS 2's nodes. Endpoints given here replace its own.
    pub config: Option<PathBuf>,
    /// Whether to keep the peers that connect here unaware of each other. Otherwise they also connect to each
    /// other, as ROS 2 nodes do: a thousand patches would make half a million connections.
    pub is_hub: bool,
}

impl SessionSettings {
    /// Opens the session.
    ///
    /// # Errors
    ///
    /// [`PublishError::Zenoh`] for an endpoint that cannot be used or a file that cannot be read.
    pub fn open(&self) -> Result<Session, PublishError> {
        let config = self.configuration()?;
        zenoh::open(config)
            .wait()
            .map_err(|source| PublishError::Zenoh { action: "open a session", source })
    }

    fn configuration(&self) -> Result<Config, PublishError> {
        let failed = |source| PublishError::Zenoh { action: "read the configuration", source };
        let of_ros = || std::env::var_os(CONFIG).filter(|path| !path.is_empty()).map(PathBuf::from);
        let mut config = match self.config.clone().or_else(of_ros) {
            Some(path) => Config::from_file(path).map_err(failed)?,
            None => self.base().map_err(failed)?,
        };
        for (key, endpoints) in [("connect", &self.connect), ("listen", &self.listen)] {
            if !endpoints.is_empty() {
                insert(&mut config, &format!("{key}/endpoints"), endpoints).map_err(failed)?;
            }
        }
        Ok(config)
    }

    /// Configures a session like `rmw_zenoh`. Zenoh 1.10 routers do not forward between peers:
    /// nodes that meet at a router connect to each other.
    fn base(&self) -> zenoh::Result<Config> {
        let mut config = Config::from_json5(
            r#"{
                mode: "peer",
                scouting: {
                    multicast: { enabled: false },
                    gossip: {
                        enabled: true,
                        autoconnect: { router: [], peer: ["router", "peer"] },
                        autoconnect_strategy: {
                            peer: { to_router: "always", to_peer: "greater-zid" },
                        },
                    },
                },
                connect: {
                    retry: {
                        period_init_ms: 250, period_max_ms: 1000, period_increase_factor: 2,
                    },
                },
            }"#,
        )?;
        if self.is_hub {
            config.insert_json5("scouting/gossip/target", r#"{ router: [], peer: ["router"] }"#)?;
        }
        if self.connect.is_empty() && self.listen.is_empty() {
            insert(&mut config, "connect/endpoints", &[ROUTER.to_owned()])?;
        }
        if self.listen.is_empty() {
            insert(&mut config, "listen/endpoints", &[ANY_PORT.to_owned()])?;
        }
        Ok(config)
    }
}

fn insert(config: &mut Config, key: &str, endpoints: &[String]) -> zenoh::Result<()> {
    config.insert_json5(key, &serde_json::to_string(endpoints)?)
}
