//! A private message of this project: the video streams of a payload station (50025), since no source gives the length of the
//! Uniform Resource Identifier of 32301.

use super::codec::messages;
use crate::enums::{StationBitmap1To16, VideoEncoding, VideoStreamType};
use crate::scalar::{Text, TimeStamp};

messages! {
    VideoStreamReport = 50025, "Video Stream Report", presence bytes 2
        sent(ToCucs, PushPull) own_definition() latency_ms(2000)
        note("provisional id; one for each stream, when it appears and on 17002")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        station_number_1_16: StationBitmap1To16 = 1, "Station Number 1-16", note("the payload station whose camera sends it");
        stream_number: u8 = 2, "Stream Number", note("from 1");
        stream_count: u8 = 3, "Stream Count", note("of the camera");
        stream_type: VideoStreamType = 4, "Stream Type";
        video_encoding: VideoEncoding = 5, "Video Encoding";
        horizontal_resolution: u16 = 6, "Horizontal Resolution", unit("pixel");
        vertical_resolution: u16 = 7, "Vertical Resolution", unit("pixel");
        uri: Text<160> = 8, "Uniform Resource Identifier", note("as the camera gives it: where it is reached from is not known here");
    }
}
