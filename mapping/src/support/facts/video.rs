//! A private message: the video streams of a payload station (50025).

use crate::support::row::{STAMP, facts};

facts! {
    50025 sends "at the grant of LOI 2, when a stream of a camera appears or is another, by 17001 and on 17002, one a stream" {
        "Time Stamp": STAMP;
        "Station Number 1-16": "the station of the camera";
        "Stream Number": "VIDEO_STREAM_INFORMATION.stream_id";
        "Stream Count": "VIDEO_STREAM_INFORMATION.count";
        "Stream Type": "VIDEO_STREAM_INFORMATION.type";
        "Video Encoding": "VIDEO_STREAM_INFORMATION.encoding";
        "Horizontal Resolution": "VIDEO_STREAM_INFORMATION.resolution_h";
        "Vertical Resolution": "VIDEO_STREAM_INFORMATION.resolution_v";
        "Uniform Resource Identifier": "VIDEO_STREAM_INFORMATION.uri";
    }
}
