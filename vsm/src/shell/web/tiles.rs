//! `[web] tiles`: pictures of the ground beneath what the map draws, from a PMTiles file on this computer. No other host is asked.
//!
//! A tile is looked up on a thread beside the one that flies, which waits for no disk and unpacks no directory, one tile at a time.
//! Only pictures are served: vector tiles would need styles, fonts and a second library in the page.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

use axum::body::Bytes;
use pmtiles::{
    AsyncBackend, AsyncPmTilesReader, BackendResponse, Compression, PmtError, PmtResult, TileCoord,
    TileType,
};
use serde::Serialize;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;

use crate::config::open_file;

/// An open file of tiles.
pub struct Tiles {
    reader: Arc<AsyncPmTilesReader<Disk>>,
    kind: &'static str,
    info: TilesInfo,
    /// Whose tile is looked up.
    turn: Arc<Semaphore>,
}

/// What the page must know of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TilesInfo {
    /// The lowest zoom that has tiles.
    pub min_zoom: u8,
    /// The highest.
    pub max_zoom: u8,
    /// South, west, north, east, degrees.
    pub bounds: [f64; 4],
    /// Whose map it is, to be shown as text; none where the file does not say it.
    pub attribution: Option<String>,
}

/// A file of tiles that cannot be served.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {problem}", path = path.display())]
pub struct TilesError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, and what is expected.
    pub problem: String,
}

impl Tiles {
    /// Opens a file and reads what it says of itself.
    ///
    /// # Errors
    /// It cannot be read, is no PMTiles file of version 3, or has other tiles than PNG, JPEG, WebP or AVIF.
    pub fn open(path: &Path) -> Result<Self, TilesError> {
        // On a separate thread, because the caller may be inside a runtime.
        let opened = thread::scope(|scope| {
            let open = || {
                let runtime = tokio::runtime::Builder::new_current_thread().build();
                runtime.map(|runtime| runtime.block_on(Self::read(path)))
            };
            scope.spawn(open).join()
        });
        let opened = opened.unwrap_or_else(|cause| resume_unwind(cause));
        opened.unwrap_or_else(|cause| Err(fault(path, cause)))
    }

    async fn read(path: &Path) -> Result<Self, TilesError> {
        let fault = |problem: String| fault(path, problem);
        let file = open_file(path).map_err(|cause| fault(cause.to_string()))?;
        // No directories are kept: those of a map of the world are hundreds of megabytes, and the system caches what is read often.
        let reader = AsyncPmTilesReader::try_from_source(Disk(file)).await;
        let reader = reader.map_err(|cause| {
            fault(format!(
                "{cause}; expected a PMTiles file, version 3 (`pmtiles convert map.mbtiles map.pmtiles` makes one)"
            ))
        })?;
        let header = reader.get_header();
        let kind = match header.tile_type {
            TileType::Png => "image/png",
            TileType::Jpeg => "image/jpeg",
            TileType::Webp => "image/webp",
            TileType::Avif => "image/avif",
            other => {
                let found = format!("tiles of the kind {other:?}");
                return Err(fault(format!("{found}: expected PNG, JPEG, WebP or AVIF")));
            }
        };
        if header.tile_compression != Compression::None {
            let found = format!("tiles compressed by {:?}", header.tile_compression);
            return Err(fault(format!(
                "{found}: expected pictures as they are, without further compression"
            )));
        }
        let info = TilesInfo {
            min_zoom: header.min_zoom,
            max_zoom: header.max_zoom,
            bounds: [
                header.min_latitude,
                header.min_longitude,
                header.max_latitude,
                header.max_longitude,
            ],
            attribution: attribution(&reader).await,
        };
        Ok(Self {
            reader: Arc::new(reader),
            kind,
            info,
            turn: Arc::new(Semaphore::new(1)),
        })
    }

    /// What the page must know of them.
    pub fn info(&self) -> &TilesInfo {
        &self.info
    }

    /// The content type of each tile.
    pub fn kind(&self) -> &'static str {
        self.kind
    }

    /// A tile; none where the file has none.
    ///
    /// # Errors
    /// The file can no longer be read, or is damaged there.
    pub async fn get(&self, zoom: u8, x: u32, y: u32) -> PmtResult<Option<Bytes>> {
        let Ok(place) = TileCoord::new(zoom, x, y) else {
            return Ok(None);
        };
        // Of who asks and is gone, too: hundreds of threads would take the processor from the one that flies.
        let turn = self.turn.clone().acquire_owned().await;
        let turn = turn.map_err(io::Error::other)?;
        let (reader, runtime) = (self.reader.clone(), Handle::current());
        let read = move || {
            let tile = runtime.block_on(reader.get_tile(place));
            drop(turn);
            tile
        };
        let read = tokio::task::spawn_blocking(read).await;
        read.map_err(io::Error::other)?
    }
}

impl std::fmt::Debug for Tiles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Tiles").field(&self.info).finish()
    }
}

fn fault(path: &Path, problem: impl ToString) -> TilesError {
    TilesError {
        path: path.to_owned(),
        problem: problem.to_string(),
    }
}

async fn attribution(reader: &AsyncPmTilesReader<Disk>) -> Option<String> {
    // A file need not have metadata; then nobody is named.
    let metadata = reader.get_metadata().await.ok()?;
    let metadata: serde_json::Value = serde_json::from_str(&metadata).ok()?;
    metadata["attribution"].as_str().map(str::to_owned)
}

/// Reads at a place of the file. Not the memory mapping of the crate: a mapped file that somebody cuts off ends the process by
/// SIGBUS, and with it the vehicle's link.
struct Disk(File);

impl AsyncBackend for Disk {
    async fn read(&self, offset: u64, length: usize) -> PmtResult<BackendResponse> {
        if length > MAX_READ {
            return Err(PmtError::InvalidEntry);
        }
        let mut bytes = vec![0; length];
        let mut filled = 0;
        while let Some(rest) = bytes.get_mut(filled..).filter(|rest| !rest.is_empty()) {
            match self.0.read_at(rest, offset.saturating_add(filled as u64))? {
                0 => break,
                more => filled += more,
            }
        }
        bytes.truncate(filled);
        Ok(BackendResponse::new(bytes.into()))
    }
}

/// A damaged directory may name any length: no tile and no directory that makers write comes near this.
const MAX_READ: usize = 4 << 20;

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::io::Cursor;
    use std::pin::pin;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::task::Poll;

    use pmtiles::PmTilesWriter;
    use tempfile::tempdir;

    use super::*;

    fn run<T>(test: impl Future<Output = T>) -> T {
        let runtime = tokio::runtime::Builder::new_current_thread().build();
        runtime.expect("a runtime").block_on(test)
    }

    fn written(kind: TileType, metadata: &str) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        let writer = PmTilesWriter::new(kind)
            .tile_compression(Compression::None)
            .min_zoom(1)
            .max_zoom(2)
            .bounds(8.0, 47.0, 9.0, 48.0)
            .metadata(metadata);
        let mut writer = writer.create(&mut file).expect("a writer");
        let place = TileCoord::new(1, 1, 0).expect("a place");
        writer.add_tile(place, b"a picture").expect("a tile");
        writer.finalize().expect("a file");
        file.into_inner()
    }

    #[test]
    fn a_tile_is_read_and_one_that_is_not_there_is_none() {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join("map.pmtiles");
        std::fs::write(
            &path,
            written(TileType::Png, r#"{"attribution": "© a <b>maker</b>"}"#),
        )
        .expect("a file");
        run(async {
            let tiles = Tiles::open(&path).expect("it opens");
            assert_eq!(tiles.kind(), "image/png");
            let expected = TilesInfo {
                min_zoom: 1,
                max_zoom: 2,
                bounds: [47.0, 8.0, 48.0, 9.0],
                attribution: Some("© a <b>maker</b>".to_owned()),
            };
            assert_eq!(*tiles.info(), expected);
            let tile = tiles.get(1, 1, 0).await.expect("it reads");
            assert_eq!(tile.as_deref(), Some(&b"a picture"[..]));
            for (zoom, x, y) in [(1, 0, 0), (2, 3, 3), (1, 2, 0), (255, 0, 0)] {
                let tile = tiles.get(zoom, x, y).await.expect("it reads");
                assert_eq!(tile, None, "{zoom}/{x}/{y}");
            }
        });
    }

    #[test]
    fn however_many_ask_and_are_gone_one_tile_is_looked_up_at_a_time() {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join("map.pmtiles");
        std::fs::write(&path, written(TileType::Png, "{}")).expect("a file");
        let tiles = Tiles::open(&path).expect("it opens");
        let threads = Arc::new(AtomicUsize::default());
        let counted = threads.clone();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .on_thread_start(move || {
                counted.fetch_add(1, Ordering::Relaxed);
            })
            .build();
        runtime.expect("a runtime").block_on(async {
            let another = tiles.turn.clone().try_acquire_owned();
            for _ in 0..200 {
                let mut asked = pin!(tiles.get(1, 1, 0));
                let once = poll_fn(|context| Poll::Ready(asked.as_mut().poll(context)));
                assert!(once.await.is_pending());
            }
            assert_eq!(threads.load(Ordering::Relaxed), 0, "for nobody who waits");
            drop(another);
            let tile = tiles.get(1, 1, 0).await.expect("it reads");
            assert_eq!(tile.as_deref(), Some(&b"a picture"[..]));
        });
        assert_eq!(threads.load(Ordering::Relaxed), 1);
    }

    /// Another program writes it again while the bridge flies: a tile is missing, and the process lives.
    #[test]
    fn a_file_that_is_cut_off_while_it_is_open_costs_its_tiles_alone() {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join("map.pmtiles");
        std::fs::write(&path, written(TileType::Png, "{}")).expect("a file");
        run(async {
            let tiles = Tiles::open(&path).expect("it opens");
            std::fs::write(&path, b"").expect("it is cut off");
            let fault = tiles.get(1, 1, 0).await.expect_err("it has no tile");
            assert!(fault.to_string().contains("number of bytes"), "{fault}");
        });
    }

    #[test]
    fn a_file_that_cannot_be_shown_is_refused_with_what_is_expected() {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join("map.pmtiles");
        let fault = |content: Option<&[u8]>| {
            if let Some(content) = content {
                std::fs::write(&path, content).expect("a file");
            }
            let fault = Tiles::open(&path).expect_err("it is refused");
            fault.to_string()
        };
        assert!(fault(None).contains("No such file"));
        for content in [&b""[..], b"PMTiles", &[0xff; 200], b"SQLite format 3\0"] {
            let text = fault(Some(content));
            assert!(text.contains("expected a PMTiles file"), "{text}");
        }
        let vectors = fault(Some(&written(TileType::Mvt, "{}")));
        assert!(vectors.contains("expected PNG"), "{vectors}");
    }

    /// Whatever a damaged file says, it is an error or a tile, in little memory.
    #[test]
    fn no_damage_of_a_file_does_more_than_lose_tiles() {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join("map.pmtiles");
        let whole = written(TileType::Png, "{}");
        for at in 0..whole.len().min(400) {
            for value in [0, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                std::fs::write(&path, &damaged).expect("a file");
                if let Ok(tiles) = Tiles::open(&path) {
                    let _ = run(tiles.get(1, 1, 0));
                }
            }
        }
    }
}
