//! The few requests of etcd that a shared store needs, by its JSON gateway (`/v3/...` over HTTP, etcd 3.4 and later).
//!
//! Not by its gRPC interface: the crates for that need a protocol buffer compiler on each computer that builds them.
//!
//! A request without an answer may have been applied, or may be applied later, and is repeated at the next member. So each
//! caller gives it a condition that holds only once.

use std::io;
use std::sync::atomic::{AtomicI64, AtomicUsize, Ordering};
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use serde_json::{Value, json};

/// A cluster, by the addresses of its members.
#[derive(Debug)]
pub(super) struct Etcd {
    agent: ureq::Agent,
    endpoints: Vec<String>,
    /// The member that answered last, which is asked first.
    first: AtomicUsize,
    /// The revision of the latest answer.
    revision: AtomicI64,
}

/// What has to hold for a transaction to be applied.
#[derive(Debug)]
pub(super) enum Condition<'a> {
    /// The transaction with this revision created the key, which has not been deleted since; 0: the key does not exist.
    CreatedAt(&'a str, i64),
    /// The key has this value.
    Holds(&'a str, &'a [u8]),
}

/// One change of a transaction.
#[derive(Debug)]
pub(super) enum Change {
    /// Gives a key a value. With a lease, the key is deleted when the lease ends.
    Put(String, Vec<u8>, Option<i64>),
    /// Deletes a key.
    Remove(String),
    /// Deletes all keys from this one up to, but not including, the other.
    RemoveRange(String, Vec<u8>),
}

/// A key with its value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) key: String,
    pub(super) value: Vec<u8>,
    /// The revision that created it.
    pub(super) created: i64,
    /// The revision that gave it this value.
    pub(super) changed: i64,
}

/// One page of the keys of a range.
#[derive(Debug)]
pub(super) struct Page {
    pub(super) entries: Vec<Entry>,
    /// The state that it shows: request further pages of the same state.
    pub(super) revision: i64,
    /// There are more keys behind these.
    pub(super) more: bool,
}

impl Etcd {
    /// Sends nothing yet. A request to one member takes at most `within`.
    pub(super) fn new(endpoints: &[String], within: Duration) -> Etcd {
        let config = ureq::Agent::config_builder()
            .timeout_global(Some(within))
            // A refusal carries its reason in the body, which an error would drop.
            .http_status_as_error(false)
            // The proxy of the environment is meant for browsers.
            .proxy(None)
            .build();
        Etcd {
            agent: config.into(),
            endpoints: endpoints.to_vec(),
            first: AtomicUsize::new(0),
            revision: AtomicI64::new(0),
        }
    }

    /// The revision of the latest answer: an etcd restored from a backup has a lower one than before.
    pub(super) fn revision(&self) -> i64 {
        self.revision.load(Ordering::Relaxed)
    }

    /// The key, if it exists, and etcd's revision by the same answer: other threads send requests meanwhile.
    pub(super) fn get_now(&self, key: &str) -> io::Result<(i64, Option<Entry>)> {
        let answer: Ranged = self.ask("kv/range", &json!({ "key": STANDARD.encode(key) }))?;
        self.note(&answer.header);
        let revision = answer.header.revision.0;
        Ok((revision, answer.page()?.entries.pop()))
    }

    fn note(&self, header: &Header) {
        // Stored, not raised to a maximum: a lower revision is what reveals a restored etcd.
        self.revision.store(header.revision.0, Ordering::Relaxed);
    }

    /// Applies all changes at once if all conditions hold, and returns the new revision. `None` if a condition does not
    /// hold.
    pub(super) fn transact(
        &self,
        conditions: &[Condition<'_>],
        changes: &[Change],
    ) -> io::Result<Option<i64>> {
        let compare: Vec<Value> = conditions.iter().map(Condition::to_json).collect();
        let success: Vec<Value> = changes.iter().map(Change::to_json).collect();
        let answer: Transacted =
            self.ask("kv/txn", &json!({ "compare": compare, "success": success }))?;
        self.note(&answer.header);
        Ok(answer.succeeded.then_some(answer.header.revision.0))
    }

    /// The key, if it exists.
    pub(super) fn get(&self, key: &str) -> io::Result<Option<Entry>> {
        self.get_now(key).map(|(_, entry)| entry)
    }

    /// Up to `limit` keys that begin with `prefix`, from `from` on, as of `revision` (0: now).
    pub(super) fn list(
        &self,
        prefix: &str,
        from: &str,
        limit: u32,
        revision: i64,
    ) -> io::Result<Page> {
        let question = json!({
            "key": STANDARD.encode(from),
            "range_end": STANDARD.encode(end_of(prefix)),
            "limit": limit.to_string(),
            "revision": revision.to_string(),
        });
        self.ask::<Ranged>("kv/range", &question)?.page()
    }

    /// A lease that ends `ttl_s` after it was last granted or kept alive.
    pub(super) fn grant(&self, ttl_s: u64) -> io::Result<i64> {
        let answer: Granted = self.ask("lease/grant", &json!({ "TTL": ttl_s.to_string() }))?;
        Ok(answer.id.0)
    }

    /// Restarts a lease's time; false if it has ended.
    pub(super) fn keep_alive(&self, lease: i64) -> io::Result<bool> {
        // A lease that has ended is answered with a TTL of 0, which the gateway leaves out.
        let answer: KeptAlive = self.ask("lease/keepalive", &json!({ "ID": lease.to_string() }))?;
        Ok(answer.result.ttl.0 > 0)
    }

    /// Ends a lease and deletes its keys.
    pub(super) fn revoke(&self, lease: i64) -> io::Result<()> {
        self.ask::<Value>("lease/revoke", &json!({ "ID": lease.to_string() }))
            .map(drop)
    }

    /// Sends the request to the members in turn until one answers.
    fn ask<T: for<'a> Deserialize<'a>>(&self, path: &str, question: &Value) -> io::Result<T> {
        let question = question.to_string();
        let first = self.first.load(Ordering::Relaxed);
        let mut fault = io::Error::other("no endpoint is configured");
        for turn in 0..self.endpoints.len() {
            let at = (first + turn) % self.endpoints.len();
            match self.ask_one(&self.endpoints[at], path, &question) {
                Ok(bytes) => {
                    self.first.store(at, Ordering::Relaxed);
                    return serde_json::from_slice(&bytes).map_err(|cause| {
                        io::Error::other(format!(
                            "{}: no answer of etcd's JSON gateway: {cause}",
                            self.endpoints[at]
                        ))
                    });
                }
                Err(cause) => fault = cause,
            }
        }
        Err(fault)
    }

    fn ask_one(&self, endpoint: &str, path: &str, question: &str) -> io::Result<Vec<u8>> {
        let named =
            |cause: &dyn std::fmt::Display| io::Error::other(format!("{endpoint}: {cause}"));
        let sent = self
            .agent
            .post(format!("{endpoint}/v3/{path}"))
            .content_type("application/json")
            .send(question);
        let unreached = |cause| {
            format!(
                "{cause}; see that etcd runs there, and that store.endpoints are where its clients find it"
            )
        };
        let mut answer = sent.map_err(|cause| named(&unreached(cause)))?;
        let read = answer.body_mut().with_config().limit(MAX_ANSWER);
        let bytes = read.read_to_vec().map_err(|cause| named(&cause))?;
        if !answer.status().is_success() {
            // The body gives the reason. For a server that is not an etcd only the status is worth showing.
            let reason: Option<Refused> = serde_json::from_slice(&bytes).ok();
            let reason = reason.map_or_else(|| answer.status().to_string(), |it| it.error);
            return Err(named(&reason));
        }
        Ok(bytes)
    }
}

impl Condition<'_> {
    fn to_json(&self) -> Value {
        match self {
            Condition::CreatedAt(key, revision) => json!({
                "target": "CREATE",
                "result": "EQUAL",
                "key": STANDARD.encode(key),
                "create_revision": revision.to_string(),
            }),
            Condition::Holds(key, value) => json!({
                "target": "VALUE",
                "result": "EQUAL",
                "key": STANDARD.encode(key),
                "value": STANDARD.encode(value),
            }),
        }
    }
}

impl Change {
    fn to_json(&self) -> Value {
        match self {
            Change::Put(key, value, lease) => json!({ "request_put": {
                "key": STANDARD.encode(key),
                "value": STANDARD.encode(value),
                "lease": lease.unwrap_or(0).to_string(),
            }}),
            Change::Remove(key) => json!({ "request_delete_range": {
                "key": STANDARD.encode(key),
            }}),
            Change::RemoveRange(from, end) => json!({ "request_delete_range": {
                "key": STANDARD.encode(from),
                "range_end": STANDARD.encode(end),
            }}),
        }
    }
}

impl Change {
    /// Deletes all keys that begin so.
    pub(super) fn remove_all(prefix: String) -> Change {
        let end = end_of(&prefix);
        Change::RemoveRange(prefix, end)
    }
}

/// The first key after all that begin with `prefix`. Keys here are ASCII, so the last byte cannot overflow.
fn end_of(prefix: &str) -> Vec<u8> {
    let mut end = prefix.as_bytes().to_vec();
    if let Some(last) = end.last_mut() {
        *last += 1;
    }
    end
}

/// The gateway writes 64-bit integers as strings and omits zeros.
#[derive(Debug, Clone, Copy, Default)]
struct Int64(i64);

impl<'de> Deserialize<'de> for Int64 {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Int64, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map(Int64).map_err(serde::de::Error::custom)
    }
}

#[derive(Debug, Default, Deserialize)]
struct Header {
    #[serde(default)]
    revision: Int64,
}

#[derive(Debug, Deserialize)]
struct Transacted {
    header: Header,
    #[serde(default)]
    succeeded: bool,
}

#[derive(Debug, Deserialize)]
struct Ranged {
    header: Header,
    #[serde(default)]
    kvs: Vec<KeyValue>,
    #[serde(default)]
    more: bool,
}

#[derive(Debug, Deserialize)]
struct KeyValue {
    key: String,
    #[serde(default)]
    value: String,
    #[serde(default)]
    create_revision: Int64,
    #[serde(default)]
    mod_revision: Int64,
}

#[derive(Debug, Deserialize)]
struct Granted {
    #[serde(rename = "ID")]
    id: Int64,
}

#[derive(Debug, Deserialize)]
struct KeptAlive {
    result: Lease,
}

#[derive(Debug, Deserialize)]
struct Lease {
    #[serde(rename = "TTL", default)]
    ttl: Int64,
}

#[derive(Debug, Deserialize)]
struct Refused {
    error: String,
}

impl Ranged {
    fn page(self) -> io::Result<Page> {
        let decode = |text: &str| STANDARD.decode(text).map_err(io::Error::other);
        let entry = |one: KeyValue| {
            Ok(Entry {
                key: String::from_utf8(decode(&one.key)?).map_err(io::Error::other)?,
                value: decode(&one.value)?,
                created: one.create_revision.0,
                changed: one.mod_revision.0,
            })
        };
        Ok(Page {
            entries: self.kvs.into_iter().map(entry).collect::<io::Result<_>>()?,
            revision: self.header.revision.0,
            more: self.more,
        })
    }
}

/// A page of pieces has about 1 MB; the bound keeps a broken server from filling this node's memory.
const MAX_ANSWER: u64 = 16 * 1024 * 1024;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_range_is_behind_all_keys_that_begin_so() {
        assert_eq!(end_of("vsm/1b000001/"), b"vsm/1b0000010");
    }

    #[test]
    fn what_the_gateway_leaves_out_is_zero() {
        // As etcd 3.4.23 answers for a lease that has ended, and for a transaction that was not applied.
        let ended: KeptAlive =
            serde_json::from_str(r#"{"result":{"header":{"revision":"2"},"ID":"1234"}}"#).unwrap();
        assert_eq!(ended.result.ttl.0, 0);
        let refused: Transacted = serde_json::from_str(r#"{"header":{"revision":"2"}}"#).unwrap();
        assert!(!refused.succeeded);
    }

    #[test]
    fn an_endpoint_that_is_no_etcd_is_named() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        drop(listener);
        let etcd = Etcd::new(std::slice::from_ref(&endpoint), Duration::from_secs(1));
        let fault = etcd.get("any").unwrap_err().to_string();
        assert!(fault.contains(&endpoint), "{fault}");
    }
}
