"""A web client: takes control, launches, loiters, lands and releases over the WebSocket of docs/guide/websocket.md.

    pip install websockets; python examples/web_client.py 127.0.0.1:8586 1b:00:00:b0 b0.key
"""
import hashlib, hmac, itertools, json, os, sys, time
from websockets.sync.client import connect

PAGE, CUCS, VEHICLE = sys.argv[1], sys.argv[2], "1b:00:01:01"
KEY = bytes.fromhex(open(sys.argv[3]).read())
mac = lambda key, data: hmac.digest(key, data, hashlib.sha256)
socket = connect(f"ws://{PAGE}/control", proxy=None)
opening, random = json.loads(socket.recv())["challenge"], os.urandom(32)
about = b"vsm-web-1" + bytes.fromhex((opening["vsm"] + CUCS).replace(":", "") + opening["random"]) + random
# HKDF-SHA256 without a salt, and from that the key of this connection: one for each direction.
to_vsm, to_us = (mac(mac(mac(bytes(32), KEY), info + b"\x01"), about) for info in (b"c2v", b"v2c"))
sent, received, stamp = itertools.count(), itertools.count(), 0
def send(kind, body):
    text = json.dumps({"n": next(sent), kind: body})
    socket.send(mac(to_vsm, text.encode()).hex() + " " + text)
def receive():
    seal, text = socket.recv(timeout=10).split(" ", 1)
    frame = json.loads(text)
    assert hmac.compare_digest(seal, mac(to_us, text.encode()).hex()) and frame["n"] == next(received), "not from the VSM"
    return frame
def message(id, to=VEHICLE, **fields):
    global stamp
    stamp = max(stamp + 1, int((time.time() - 946_684_800) * 1000))  # Milliseconds since 2000; each once.
    send("message", {"id": id, "destination": to, "ack": id != 16002, "fields": {"Time Stamp": stamp, **fields}})
    return stamp
def wait(accept, beat=0.0):
    while True:
        if time.monotonic() > beat:  # A heartbeat each second keeps control.
            beat = time.monotonic() + 1; message(16002, opening["vsm"])
        got = receive().get("message")
        if got and accept(got["id"], got["fields"]):
            return got["fields"]
def mode(name, **fields):
    of = message(2016, **{"Select Flight Path Control Mode": name}, **fields)
    end = wait(lambda id, f: id == 17000 and f["Original Message Time Stamp"] == of and f["Acknowledgement Type"] in ("carried out", "refused"))
    print(name, end["Acknowledgement Type"])
send("hello", {"version": 1, "cucs": CUCS, "random": random.hex()})
receive()
message(1, **{"Requested/Handover LOI": ["LOI 4", "LOI 5"], "Requested/Handover Access": "request control"})
wait(lambda id, f: id == 2 and "LOI 5" in f.get("LOI Granted", []))
wait(lambda id, f: id == 4000 and "Latitude" in f)
mode("launch", **{"Altitude Command Type": "altitude", "Commanded Altitude": 20, "Altitude Type": "AGL"})
mode("loiter")
mode("autoland engage")
wait(lambda id, f: id == 3002 and f.get("UA State") in ("power up", "pre-start", "pre-launch"))
message(1, **{"Requested/Handover LOI": ["LOI 4", "LOI 5"], "Requested/Handover Access": "relinquish / hand off control"})
wait(lambda id, f: id == 2 and not f.get("LOI Granted"))
print("landed and released")
