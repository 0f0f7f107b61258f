#!/usr/bin/env python3
"""A UDP relay that loses datagrams: a bad network between a CUCS and a VSM.

    lossy_relay.py --listen 127.0.0.1:5000 --to 127.0.0.1:4586 --loss 0.05 [--seed 1]

Each client gets a socket of its own toward the VSM, so that the VSM sees as many addresses as there are.
"""
import argparse
import random
import select
import signal
import socket


class Relay:
    def __init__(self, listen, to, loss, seed=1):
        self.to, self.loss, self.dice = (socket.gethostbyname(to[0]), to[1]), loss, random.Random(seed)
        self.front = udp(listen)
        self.backs, self.clients = {}, {}
        self.lost = self.passed = 0
        self.stopped = False

    def run(self):
        while not self.stopped:
            for ready in select.select([self.front, *self.clients], [], [], 0.2)[0]:
                self.pass_on(ready)

    def stop(self, *_):
        self.stopped = True

    def pass_on(self, ready):
        try:
            datagram, address = ready.recvfrom(65535)
        except OSError:
            return
        if ready is self.front:
            if address not in self.backs:
                back = udp(("127.0.0.1", 0))
                self.backs[address], self.clients[back] = back, address
            way, target = self.backs[address], self.to
        elif address != self.to:
            # Meant for who had this port before.
            return
        else:
            way, target = self.front, self.clients[ready]
        if self.dice.random() < self.loss:
            self.lost += 1
            return
        self.passed += 1
        try:
            way.sendto(datagram, target)
        except OSError:
            pass


def udp(address):
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    s.bind(address)
    return s


def address(text):
    host, port = text.rsplit(":", 1)
    return host, int(port)


def main():
    parser = argparse.ArgumentParser(description="Pass UDP datagrams on between clients and a VSM, and lose some.")
    parser.add_argument("--listen", type=address, required=True, metavar="HOST:PORT")
    parser.add_argument("--to", type=address, required=True, metavar="HOST:PORT")
    parser.add_argument("--loss", type=float, default=0.05, help="share of the datagrams that is lost, 0 to 1")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    relay = Relay(args.listen, args.to, args.loss, args.seed)
    signal.signal(signal.SIGTERM, relay.stop)
    signal.signal(signal.SIGINT, relay.stop)
    relay.run()


if __name__ == "__main__":
    main()
