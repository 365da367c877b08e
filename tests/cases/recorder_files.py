"""Writers of recorder layouts for the tests: invented motion, values as a device prints them."""

import io
import struct

import numpy as np
import obspy

RATE = 1024
BEFORE = 0.125
AMPLITUDE = {"Tran": 12.5, "Vert": 20.0, "Long": 8.0}
FREQUENCY = {"Tran": 16.0, "Vert": 32.0, "Long": 8.0}
ONSET = {"Tran": 0.0625, "Vert": 0.0, "Long": 0.03125}
GRAVITY = 9806.65


def write(folder, content, name="record"):
    """Write text or bytes into a file and return its path."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def write_trace(path, samples, format, **header):
    """Write one vertical channel by obspy and return its path."""
    trace = obspy.Trace(np.asarray(samples), {"delta": 0.002, "channel": "HHZ"} | header)
    trace.write(str(path), format=format)
    return path


def motion(n_samples=384):
    """Two cycles of a sine on each channel, mm/s; every peak falls on a sample."""
    times = np.arange(n_samples) / RATE - BEFORE
    record = {}
    for name, size in AMPLITUDE.items():
        since = times - ONSET[name]
        on = (since >= 0.0) & (since <= 2.0 / FREQUENCY[name])
        record[name] = np.where(on, size * np.sin(2.0 * np.pi * FREQUENCY[name] * since), 0.0)
    return record


def peak_time(name):
    return ONSET[name] + 0.25 / FREQUENCY[name]


def peak_acceleration(name):
    """Largest forward difference of a sine, in g."""
    return AMPLITUDE[name] * np.sin(2.0 * np.pi * FREQUENCY[name] / RATE) * RATE / GRAVITY


def vector_sum(record):
    """Largest vector sum at one instant, mm/s, and its time."""
    length = np.sqrt(record["Tran"] ** 2 + record["Vert"] ** 2 + record["Long"] ** 2)
    return length.max(), np.argmax(length) / RATE - BEFORE


def instantel_ascii(record=None, *, changes=None, unit="mm/s", end="\n", microphone=False):
    record = motion() if record is None else record
    n_samples = len(record["Tran"])
    total, at = vector_sum(record)
    header = {
        "Event Type": "Full Waveform", "Serial Number": "XX00000",
        "Version": " V 10-89 Micromate ISEE", "File Name": "XX00000_20250102130405.IDFW",
        "Event Time": "13:04:05", "Event Date": "January 2, 2025", "Trigger": "Vert",
        "Geo Trigger Level": f"1.000 {unit}", "Pre-trigger Length": f"-{BEFORE} sec",
        "Record Time": f"{n_samples / RATE - BEFORE} sec", "Sample Rate": f"{RATE} sps",
        "Battery Level": "3.8 Volts", "Calibration": "January 1, 2025 by Instantel",
        "Units": f"{unit} and {'pa' if microphone else ''}", "Location:": "Bench  7 : north",
        "General:": "", "Geo Range": f"254.0 {unit}",
    }  # fmt: skip
    header |= {f"{n} PPV": f"{AMPLITUDE[n]:.3f} {unit}" for n in AMPLITUDE}
    header |= {f"{n} ZC Freq": f"{FREQUENCY[n]:.0f} Hz" for n in AMPLITUDE}
    header |= {f"{n} Time of Peak": f"{peak_time(n):.3f} sec" for n in AMPLITUDE}
    millimetres = 25.4 if unit == "in/s" else 1.0
    header |= {
        f"{n} Peak Acceleration": f"{millimetres * peak_acceleration(n):.3f} g" for n in AMPLITUDE
    }
    header |= {"Peak Vector Sum": f"{total:.3f} {unit}", "Peak Vector Sum Time": f"{at:.3f} sec"}
    header |= {"Tran  Test Freq": "7.7 Hz", "PC SW Version": "V 10.74"} | (changes or {})
    names = [*AMPLITUDE, *(["MicL"] if microphone else [])]
    columns = [record[n] for n in AMPLITUDE] + ([np.zeros(n_samples)] if microphone else [])
    lines = [f'"{key} : {value}"' for key, value in header.items() if value is not None]
    lines += ["", "\t".join(f" {name} " for name in names)]
    lines += ["\t".join(f" {x:.4f} " for x in row) for row in zip(*columns, strict=True)]
    return end.join([*lines, ""])


def instantel_csv(record=None, *, changes=None, decimal=".", delimiter=","):
    record = motion() if record is None else record
    header = {
        "EventType": "Full Waveform", "SampleRate": f"{RATE} sps", "Units": "mm/s and dB(L)",
        "EventTime": "13:04:05", "EventDate": "2025-01-02", "TitleNote1": "Location:",
        "TitleString1": "House 12", "SerialNumber": "UM00000", "GpsDistance": "1450.5 m",
        "PeakVectorSum": f"{vector_sum(record)[0]:.3f} mm/s", "MicPSPL": "114.6 dB(L)",
    }  # fmt: skip
    header |= {f"{n}PPV": f"{AMPLITUDE[n]:.3f} mm/s" for n in AMPLITUDE}
    header |= {f"{n}ZCFreq": f"{FREQUENCY[n]:.1f} Hz" for n in AMPLITUDE}
    header |= {f"{n}TimeofPeak": f"{peak_time(n):.3f} sec" for n in AMPLITUDE} | (changes or {})
    rows = [[key, value] for key, value in header.items() if value is not None]
    rows += [["Channel", name] for name in AMPLITUDE] + [list(AMPLITUDE)]
    rows += [
        [f"{x:.4f}".replace(".", decimal) for x in row]
        for row in zip(*(record[n] for n in AMPLITUDE), strict=True)
    ]
    return "\r\n".join(delimiter.join(f'"{cell}"' for cell in row) for row in rows) + "\r\n"


def texcel(record=None, *, frequency=RATE):
    record = motion() if record is None else record
    beside = {0: f",,,,Frequency [Hz],{frequency}", 1: ",,,,Monitor:,7917",
              2: ",,,,Calibrated:,28/05/2025"}  # fmt: skip
    rows = ["Sample Time,RADIAL,TRANSVERSE,VERTICAL,MICROPHONE", "[s],[mm/s],[mm/s],[mm/s],[Pa]"]
    rows += [
        f"{n / RATE - BEFORE:.6f},{record['Long'][n]:.4f},{record['Tran'][n]:.4f},"
        f"{record['Vert'][n]:.4f},0.0"
        for n in range(len(record["Tran"]))
    ]
    return "\n".join(row + beside.get(n, "") for n, row in enumerate(rows)) + "\n"


def vibracord(record=None, *, rate=f"{RATE} sps"):
    record = motion() if record is None else record
    sums = np.sqrt(sum(x**2 for x in record.values()))
    lines = ['"Serial number","900"', '"Date of calibration","2025-01-01"',
             '"Date & Time","2025-01-02 13:04:05"', f'"Sampling rate","{rate}"',
             f'"Pretrigger","{BEFORE} s"', '"Latitude","0.0"']  # fmt: skip
    lines.append(
        '"Time","Channel 1 (mm/s)","Channel 2 (mm/s)","Channel 3 (mm/s)",'
        '"Channel 4 (Pa)","Vector sum 1 (mm/s)"'
    )
    lines += [
        f'"{n / RATE:.6f}","{record["Vert"][n]:.4f}","{record["Long"][n]:.4f}",'
        f'"{record["Tran"][n]:.4f}","0.0","{sums[n]:.4f}"'
        for n in range(len(sums))
    ]
    return "\n".join(lines) + "\n"


def generic(header="time_s,east_m_per_s,north_m_per_s,vertical_m_per_s", rows=None):
    rows = [[0.001 * n, 1e-3 * n, -1e-3 * n, 0.0] for n in range(8)] if rows is None else rows
    return "\n".join([header, *(",".join(f"{x:.6g}" for x in row) for row in rows)]) + "\n"


def seg2(data, *, order="<", start="-0.010", descaling=None, spacing=2.0, n_promised=None, more=()):
    """One shot in SEG-2 with 32-bit floating samples; ``n_promised`` samples in the header."""
    data = np.asarray(data, dtype=order + "f4")
    n_traces = len(data)
    blocks, pointers, place = [], [], 32 + 4 * n_traces + 2
    for n, samples in enumerate(data):
        words = [f"CHANNEL_NUMBER {n + 1}", f"DELAY {start}", "SAMPLE_INTERVAL 0.001",
                 f"RECEIVER_LOCATION {spacing * n:.2f}", "SOURCE_LOCATION -5.00"]  # fmt: skip
        words += [f"DESCALING_FACTOR {descaling}"] if descaling else []
        words += more
        free = (
            b"".join(
                struct.pack(order + "H", len(word) + 3) + word.encode() + b"\0" for word in words
            )
            + b"\0\0"
        )
        size = 32 + len(free)
        head = struct.pack(
            order + "HHIIB",
            0x4422,
            size,
            samples.nbytes,
            len(samples) if n_promised is None else n_promised,
            4,
        )
        block = head.ljust(32, b"\0") + free + samples.tobytes()
        pointers.append(place)
        blocks.append(block)
        place += len(block)
    mark = b"\x55\x3a" if order == "<" else b"\x3a\x55"
    first = mark + struct.pack(order + "HHH", 1, 4 * n_traces, n_traces) + b"\x01\0\0\x01\n\0"
    table = struct.pack(f"{order}{n_traces}I", *pointers)
    return first.ljust(32, b"\0") + table + b"\0\0" + b"".join(blocks)


def miniseed(stations, *, dtype="f8", start="2025-01-02T03:04:05", codes="ENZ", **options):
    """Stations (name to (n_samples, 3)) as miniSEED with channels HHE, HHN, HHZ at 500 Hz."""
    header = {"network": "XX", "delta": 0.002, "starttime": obspy.UTCDateTime(start)}
    stream = obspy.Stream(
        obspy.Trace(column.astype(dtype), header | {"station": name, "channel": f"HH{code}"})
        for name, samples in stations.items()
        for code, column in zip(codes, samples.T, strict=True)
    )
    target = io.BytesIO()
    stream.write(target, format="MSEED", **options)
    return target.getvalue()


def sac(order="<", version=6, n_samples=10, value=1.0, given=10, longitude=-12345.0):
    """A SAC file with the fields that the reader needs."""
    numbers = [-12345.0] * 70
    numbers[0], numbers[5], numbers[6] = 0.002, 0.0, 0.018
    numbers[31:33], numbers[35:37] = [0.0, longitude], [0.0, 0.0]
    integers = [-12345] * 40
    integers[:6] = [2025, 2, 3, 4, 5, 0]
    integers[6], integers[9], integers[15], integers[35] = version, n_samples, 1, 1
    head = struct.pack(f"{order}70f40i", *numbers, *integers) + b"-12345  " * 24
    return head + struct.pack(f"{order}{given}f", *([value] * given))


RECORDS = {  # a file of each format, those of SAC and GSE2 by its name: obspy writes them
    "INSTANTEL_ASCII": instantel_ascii(), "INSTANTEL_CSV": instantel_csv(),
    "TEXCEL": texcel(), "VIBRACORD": vibracord(), "CSV": generic(),
    "MSEED": miniseed({"R01": np.random.default_rng(3).normal(size=(300, 3))}),
    "SAC": "SAC", "GSE2": "GSE2",
}  # fmt: skip
