"""The control protocol of GigE Vision, as far as the tests need it: commands and acknowledgements, and a client."""

import socket
import struct

PORT = 3956
KEY = 0x42
ACK_WANTED = 1
DISCOVERY, READ_REGISTER, WRITE_REGISTER, READ_MEMORY = 0x02, 0x80, 0x82, 0x84
ACCESS_DENIED, WRITE_PROTECTED = 0x8006, 0x8004
# Registers that every device has at these places.
FIRST_URL, URL_BYTES = 0x0200, 512
CONTROL_PRIVILEGE = 0x0A00
EXCLUSIVE = 1
# Of memory, at most so many bytes in one packet.
MOST_BYTES = 512


class Client:
    """Whoever talks to a camera."""

    def __init__(self, address):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(5)
        self.socket.connect((address, PORT))
        self.number = 0

    def ask(self, command, payload):
        self.number = self.number % 0xFFFF + 1
        self.socket.send(struct.pack(">BBHHH", KEY, ACK_WANTED, command, len(payload), self.number) + payload)
        while True:
            answer = self.socket.recv(2048)
            status, _, length, number = struct.unpack(">HHHH", answer[:8])
            if number == self.number:
                assert status == 0, f"the camera refuses {command:#x}: {status:#x}"
                return answer[8 : 8 + length]

    def register(self, address):
        return struct.unpack(">I", self.ask(READ_REGISTER, struct.pack(">I", address)))[0]

    def write_register(self, address, value):
        self.ask(WRITE_REGISTER, struct.pack(">II", address, value))

    def memory(self, address, count):
        data = b""
        while len(data) < count:
            part = min(MOST_BYTES, count - len(data) + 3 & ~3)
            data += self.ask(READ_MEMORY, struct.pack(">IHH", address + len(data), 0, part))[4:]
        return data[:count]

    def description(self):
        """The camera's own description of its features, which is at the place that its first URL says."""
        url = self.memory(FIRST_URL, URL_BYTES).split(b"\0")[0].decode()
        _, place, length = url.split(";")
        return self.memory(int(place, 16), int(length, 16)).split(b"\0")[0].decode()
