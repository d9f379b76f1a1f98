"""A camera that answers and sends no frames: what Aravis's has not. It has limits and units, counts how often it was read, and
plays one that another program has for itself alone, or one whose description has no end.

camera.py ADDRESS SERIAL [exclusive | endless]

Writes a line each time its description is read from the beginning.
"""

import socket
import struct
import sys

import gvcp

DESCRIPTION_AT = 0x0010_0000
WIDTH, HEIGHT, FORMAT, EXPOSURE, GAIN, GAIN_AUTO, RATE, BLACK, LIMIT = range(0xF000, 0xF024, 4)
FORMATS = {"Mono8": 0x0108_0001, "Mono12Packed": 0x010C_0006, "Mono12p": 0x010C_0047}


def register(name, address, sign="Unsigned"):
    return f"""<IntReg Name="{name}"><Address>{address:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>
<pPort>Device</pPort><Sign>{sign}</Sign><Endianess>BigEndian</Endianess></IntReg>"""


def converter(name, of, scale):
    """Numbers of which `scale` make one."""
    return f"""<Converter Name="{name}"><FormulaTo>FROM * {scale}</FormulaTo><FormulaFrom>TO / {scale}</FormulaFrom>
<pValue>{of}</pValue><Slope>Increasing</Slope></Converter>"""


def enumeration(name, entries, register_name):
    each = "".join(f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>' for entry, value in entries.items())
    return f'<Enumeration Name="{name}">{each}<pValue>{register_name}</pValue></Enumeration>'


FEATURES = ["Width", "Height", "PixelFormat", "ExposureTime", "Gain", "GainAuto", "AcquisitionFrameRate", "BlackLevel"]
DESCRIPTION = f"""<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Stranger" VendorName="Nobody" StandardNameSpace="GEV" SchemaMajorVersion="1"
 SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ToolTip="" ProductGuid="4F4B9B1E-4F3E-4F0B-9A51-5B8E6A0C0D01" VersionGuid="4F4B9B1E-4F3E-4F0B-9A51-5B8E6A0C0D02"
 xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
<Category Name="Root"><pFeature>Control</pFeature></Category>
<Category Name="Control">{"".join(f"<pFeature>{name}</pFeature>" for name in FEATURES)}</Category>
<Integer Name="Width"><pValue>WidthRegister</pValue><Min>16</Min><Max>2048</Max><Inc>16</Inc></Integer>
<Integer Name="Height"><pValue>HeightRegister</pValue><Min>2</Min><pMax>HeightLimit</pMax><Inc>2</Inc></Integer>
{enumeration("PixelFormat", FORMATS, "FormatRegister")}
<Float Name="ExposureTime"><pValue>ExposureScaled</pValue><Min>10</Min><Max>1000000</Max><Unit>us</Unit></Float>
<Float Name="Gain"><pValue>GainScaled</pValue><Min>-1.5</Min><Max>24</Max><Unit>dB</Unit></Float>
{enumeration("GainAuto", {"Off": 0, "Continuous": 1}, "GainAutoRegister")}
<Float Name="AcquisitionFrameRate"><pValue>RateScaled</pValue><Min>0.5</Min><Max>120</Max><Unit>Hz</Unit></Float>
<Integer Name="BlackLevel"><pValue>BlackRegister</pValue><Min>-16</Min><Max>255</Max></Integer>
{converter("ExposureScaled", "ExposureRegister", 10)}
{converter("GainScaled", "GainRegister", 100)}
{converter("RateScaled", "RateRegister", 1000)}
<IntSwissKnife Name="HeightLimit"><pVariable Name="LIMIT">LimitRegister</pVariable><Formula>LIMIT * 2</Formula></IntSwissKnife>
{register("WidthRegister", WIDTH)}
{register("HeightRegister", HEIGHT)}
{register("FormatRegister", FORMAT)}
{register("ExposureRegister", EXPOSURE)}
{register("GainRegister", GAIN, "Signed")}
{register("GainAutoRegister", GAIN_AUTO)}
{register("RateRegister", RATE)}
{register("BlackRegister", BLACK, "Signed")}
{register("LimitRegister", LIMIT)}
<Port Name="Device"></Port>
</RegisterDescription>
""".encode()


def memory(endless):
    length = 0x4000_0000 if endless else len(DESCRIPTION)
    url = f"Local:stranger.xml;{DESCRIPTION_AT:x};{length:x}".encode()
    held = bytearray(DESCRIPTION_AT) + DESCRIPTION + bytes(gvcp.MOST_BYTES)
    held[gvcp.FIRST_URL : gvcp.FIRST_URL + len(url)] = url
    numbers = {WIDTH: 640, HEIGHT: 480, FORMAT: FORMATS["Mono8"], EXPOSURE: 123_456}
    numbers |= {GAIN: -125, RATE: 29_970, BLACK: -3, LIMIT: 512}
    for at, number in numbers.items():
        held[at : at + 4] = struct.pack(">i", number)
    return held


def identity(address, serial):
    """What a camera says of itself to whoever looks for one."""
    whole = bytearray(248)
    said = {
        0: struct.pack(">HH", 2, 0),
        10: bytes([2, 0, 0, 0, 0, 3]),
        36: socket.inet_aton(address),
        52: socket.inet_aton("255.255.255.0"),
        72: b"Nobody",
        104: b"Stranger",
        136: b"1.0",
        216: serial.encode(),
    }
    for at, words in said.items():
        whole[at : at + len(words)] = words
    return bytes(whole)


def main():
    address, serial, plays = sys.argv[1], sys.argv[2], sys.argv[3:]
    held = memory("endless" in plays)
    here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    here.bind(("", gvcp.PORT))
    while True:
        packet, sender = here.recvfrom(2048)
        _, _, command, _, number = struct.unpack(">BBHHH", packet[:8])
        status, answer = 0, b""
        if command == gvcp.DISCOVERY:
            answer = identity(address, serial)
        elif "exclusive" in plays:
            status = gvcp.ACCESS_DENIED
        elif command == gvcp.READ_MEMORY:
            at, _, count = struct.unpack(">IHH", packet[8:16])
            if at == DESCRIPTION_AT:
                print("read", flush=True)
            answer = packet[8:12] + bytes(held[at : at + count]).ljust(count, b"\0")
        elif command == gvcp.READ_REGISTER:
            places = struct.unpack(f">{len(packet[8:]) // 4}I", packet[8:])
            answer = b"".join(bytes(held[at : at + 4]) for at in places)
        else:
            status = gvcp.WRITE_PROTECTED
        here.sendto(struct.pack(">HHHH", status, command + 1, len(answer), number) + answer, sender)


main()
