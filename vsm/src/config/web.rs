//! `[http]` and `[web]`: where the page is, what its map shows of the ground, whether stations may come by its WebSocket, and what
//! that needs of the rest of the file.

use std::net::SocketAddr;
use std::path::PathBuf;

use serde::Deserialize;
use toml::Spanned;

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Value};
use super::key::table;
use super::station::Cucs;

table! {
    /// `[http]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Http {
        /// TCP address of the status page
        pub listen: SocketAddr => Nothing("none"),
        /// Names that it may be requested by, beside `localhost` and its address: those of a proxy before it
        #[serde(default)]
        pub hosts: Vec<String> => Value("[]"),
    }
}

table! {
    /// `[web]`
    #[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Web {
        /// Take the CUCSs with `web = true` by a WebSocket of the page, `/control`, under their guard keys
        /// ([websocket.md](../guide/websocket.md)). `http.listen` must be an address of loopback then
        pub control: bool => Value("false"),
        /// A PMTiles file of pictures (PNG, JPEG, WebP, AVIF) that the map shows beneath vehicles and routes; read from this
        /// computer alone
        pub tiles: Option<PathBuf> => Nothing("the map has a grid"),
    }
}

impl Web {
    /// What the rest of the file must have for it.
    pub(super) fn check(&self, http: Option<&Http>, cucs: &[Spanned<Cucs>]) -> Result<(), Fault> {
        for spanned in cucs {
            self.check_station(spanned.get_ref(), spanned.span().start)?;
        }
        if let (Some(tiles), None) = (&self.tiles, http) {
            let expected = "an address of the page, [http] listen = \"127.0.0.1:8586\"";
            return fault(
                0,
                "web.tiles",
                format!("{} without [http]", tiles.display()),
                expected,
            );
        }
        if !self.control {
            return Ok(());
        }
        let Some(http) = http else {
            let expected = "an address of the page, [http] listen = \"127.0.0.1:8586\"";
            return fault(0, "web.control", "true without [http]", expected);
        };
        if !http.listen.ip().is_loopback() {
            // On an unencrypted network an attacker could change the page itself in transit, and steal the key that is
            // typed into it.
            let expected = "an address of loopback such as 127.0.0.1:8586, since web.control is true: from elsewhere by a proxy \
                            with TLS on this computer, or ssh -L";
            return fault(0, "http.listen", http.listen, expected);
        }
        Ok(())
    }

    fn check_station(&self, cucs: &Cucs, at: usize) -> Result<(), Fault> {
        if !cucs.web {
            return Ok(());
        }
        if !self.control {
            return fault(
                at,
                "cucs.web",
                true,
                "[web] control = true, or no such line",
            );
        }
        if cucs.guard.is_none() {
            let expected =
                "guard = { key_file = \"FILE\" } beside it: a web client has no other proof";
            return fault(at, "cucs.web", "true without a guard", expected);
        }
        let set = [
            ("cucs.edition", cucs.edition.is_some()),
            ("cucs.checksum", cucs.checksum.is_some()),
            ("cucs.presence", cucs.presence.is_some()),
            ("cucs.disputed", cucs.disputed.set().next().is_some()),
        ];
        match set.into_iter().find(|(_, set)| *set) {
            None => Ok(()),
            Some((key, _)) => {
                let expected =
                    "no such key: what a web client is sent is JSON, with what is known in it";
                fault(at, key, "set, with web = true", expected)
            }
        }
    }
}
