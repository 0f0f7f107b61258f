// A beat each second, in a thread of its own: a browser slows down the timers of a page that is not looked at, and a ground
// station that sends no heartbeat counts as lost.

setInterval(() => postMessage(null), 1000);
