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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::Config;

    const HTTP: &str = "[http]\nlisten = \"127.0.0.1:8586\"\n";
    const CONTROL: &str = "[web]\ncontrol = true\n";
    const CLIENT: &str = "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 4, 5]\nweb = true\n";
    const GUARD: &str = "guard = { key_file = \"b0.key\" }\n";

    fn parse(tables: &[&str]) -> Result<Config, String> {
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:4586\"\n[store]\ndir = \"state\"\n{}",
            tables.concat()
        );
        Config::parse(&text, Path::new("")).map_err(|fault| fault.to_string())
    }

    #[test]
    fn without_a_table_nobody_comes_by_the_web_and_the_map_has_a_grid() {
        let web = parse(&[HTTP]).unwrap().web;
        assert_eq!(web, Web::default());
        assert!(!web.control && web.tiles.is_none());
    }

    #[test]
    fn what_a_web_client_and_the_map_need_of_the_rest_is_named() {
        let client = [HTTP, CONTROL, CLIENT, GUARD];
        let config = parse(&client).unwrap();
        assert!(config.web.control && config.stations().all(|one| one.web));
        let everywhere = "[http]\nlisten = \"0.0.0.0:8586\"\n";
        let tiles = "[web]\ntiles = \"map.pmtiles\"\n";
        let with = |line: &'static str| [&client[..], &[line]].concat();
        for (tables, fault) in [
            (vec![tiles], "web.tiles is map.pmtiles without [http], "),
            (
                vec![CONTROL, CLIENT, GUARD],
                "web.control is true without [http], ",
            ),
            (
                vec![everywhere, CONTROL, CLIENT, GUARD],
                "http.listen is 0.0.0.0:8586, expected an address of loopback",
            ),
            (
                vec![HTTP, CLIENT, GUARD],
                "cucs.web is true, expected [web] control = true",
            ),
            (
                vec![HTTP, CONTROL, CLIENT],
                "cucs.web is true without a guard, ",
            ),
            (with("edition = \"4\"\n"), "cucs.edition is set, "),
            (with("checksum = \"sum16\"\n"), "cucs.checksum is set, "),
            (with("presence = \"full\"\n"), "cucs.presence is set, "),
            (
                with("disputed = { ack_type = \"0,1,2\" }\n"),
                "cucs.disputed is set, ",
            ),
        ] {
            let found = parse(&tables).unwrap_err();
            assert!(found.contains(fault), "{found}, expected {fault}");
        }
    }
}
