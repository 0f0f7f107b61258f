//! Our programs and other people's: a ground station in Python that shares no code with the bridge (`cucs`), a second VSM
//! and a second CUCS in Python (`second`), both and our own under the conformance suite (`conformance`), the reference codec of the DLI (`dli`), the Python package of the codec
//! (`python`), a web client in Python (`web_client`), pymavlink (`signing`, `pitfalls`, `forward`), MAVSDK, MAVProxy, and Wireshark (`dissector`,
//! `wireshark`), klvdata (`klv`), and Chromium (`browser`).

mod browser;
mod conformance;
mod cucs;
mod dissector;
mod dli;
mod forward;
mod klv;
mod mavproxy;
mod mavsdk;
mod pitfalls;
mod pymavlink;
mod python;
mod second;
mod signing;
mod web_client;
mod wireshark;
