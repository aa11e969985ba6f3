// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives the SoC by commands. Argument: clocks per bit of the serial line. Numbers have their low byte first. The file is
// compiled for PPC pixels per clock, and with or without waves.
//
// Standard input, commands of one byte and what follows:
//   L count:32 words:32...                       reset with a program: the words from the start of the RAM
//   Z clocks:32                                  reset for so many clocks; the RAM stays
//   U count:32 bytes                             bytes to send on the serial line, after those that are still to be sent
//   P camera:8 flags:8 idle:32 count:32 bytes    a row of pixels, after those that are still to be sent: flags 1 is tuser on
//                                                its first beat, 2 tlast on its last, 4 it is the last row of a frame; then so
//                                                many idle clocks
//   T from:64 clocks:64 count:32 bytes           writes the waves of so many clocks into a file of that name (VCD)
//   C clocks:32                                  a microsecond of the SoC has so many clocks from here on; 0: whatever it says itself
//   H                                            no access to the IP is answered any more, until the watchdog's reset
//   E count:32                                   after so many accesses to the IP the next one goes to address 0: to nothing
//   R clocks:64                                  runs
// Standard output, after each R:
//   clock:64                                     clocks since the first reset
//   pins:8                                       1: lasers, 2: trigger
//   triggers:32 trigger:64                       rising edges of the trigger so far, clock of the last one
//   results:32 results:64                        pairs of frames whose results were made ready so far, clock of the last one
//   frames:32 first:64 last:64 pending:32 stalled:64, per camera
//                                                frames with a last row so far, clocks of the first and the last beat of the
//                                                last one; beats to come; clocks in which one waited
//   unsent:32                                    bytes of the serial line to come
//   count:32 (byte:8 clock:64)...                bytes from the serial line, each with the clock its start bit began at; a byte
//                                                without stop bit is not there

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>
#include <vector>

#include "Vdut.h"
#include "verilated.h"
#if VM_TRACE
#include "verilated_vcd_c.h"
#endif

static Vdut dut;
static uint64_t clocks;

// A clock is 10 ns in the waves.
#if VM_TRACE
static VerilatedVcdC waves;
static uint64_t waves_from;
static uint64_t waves_to;

static void dump(uint64_t ns) {
    if (clocks < waves_from || !waves.isOpen()) return;
    if (clocks < waves_to) {
        waves.dump(ns);
    } else {
        waves.close();
    }
}

static void trace(uint64_t from, uint64_t length, const char* path) {
    dut.trace(&waves, 99);
    waves.set_time_unit("1ns");
    waves.set_time_resolution("1ns");
    waves.open(path);
    waves_from = from;
    waves_to = from + length;
}
#else
static void dump(uint64_t) {}

static void trace(uint64_t, uint64_t, const char*) {
    fprintf(stderr, "compiled without waves\n");
    exit(1);
}
#endif

// What the inputs make of the state is there
static void settle() {
    dut.clk = 0;
    dut.eval();
    dump(10 * clocks + 5);
}

static void rise() {
    dut.clk = 1;
    dut.eval();
    clocks++;
    dump(10 * clocks);
}

static void tick() {
    settle();
    rise();
}

// Reads a number; the end of the input ends the program.
template <typename Number> static Number get() {
    Number number;
    if (fread(&number, sizeof number, 1, stdin) != 1) exit(0);
    return number;
}

template <typename Number> static void put(Number number) { fwrite(&number, sizeof number, 1, stdout); }

static std::vector<uint8_t> get_bytes(uint32_t count) {
    std::vector<uint8_t> bytes(count);
    if (count > 0 && fread(bytes.data(), count, 1, stdin) != 1) exit(0);
    return bytes;
}

// Start bit, 8 data bits, stop bit: in both directions.
struct Serial {
    enum { BITS = 10 };

    struct Byte {
        uint8_t byte;
        uint64_t clock;
    };

    uint32_t clocks_per_bit = 0;
    std::deque<uint8_t> to_send;
    unsigned bits_to_send = 0;
    uint32_t wait_to_send = 0;
    unsigned shift_out = 0;
    std::vector<Byte> received;
    unsigned bits_to_come = 0;
    uint32_t wait_for_bit = 0;
    unsigned shift_in = 0;
    uint64_t start = 0;
    bool was_high = true;

    uint8_t drive() {
        if (wait_to_send > 0) {
            wait_to_send--;
        } else if (bits_to_send > 1) {
            bits_to_send--;
            shift_out >>= 1;
            wait_to_send = clocks_per_bit - 1;
        } else if (!to_send.empty()) {
            shift_out = 1u << 9 | to_send.front() << 1;
            to_send.pop_front();
            bits_to_send = BITS;
            wait_to_send = clocks_per_bit - 1;
        } else {
            bits_to_send = 0;
        }
        return bits_to_send > 0 ? shift_out & 1 : 1;
    }

    void look(bool line) {
        if (bits_to_come == 0) {
            if (!line && was_high) {
                bits_to_come = BITS;
                wait_for_bit = clocks_per_bit / 2;
                start = clocks;
            }
        } else if (wait_for_bit > 0) {
            wait_for_bit--;
        } else {
            wait_for_bit = clocks_per_bit - 1;
            bits_to_come--;
            shift_in = shift_in >> 1 | (line ? 1u << 9 : 0);
            if (bits_to_come == 0 && line) received.push_back({static_cast<uint8_t>(shift_in >> 1), start});
        }
        was_high = line;
    }
};

struct Row {
    uint8_t flags;
    uint32_t idle;
    std::vector<uint8_t> data;
};

// Rows to an input, beat by beat.
struct Camera {
    std::deque<Row> rows;
    size_t next = 0;  // byte of the first row
    uint32_t idle = 0;
    uint32_t pending = 0;
    uint32_t frames = 0;
    uint64_t start = 0;  // clock of the last beat with tuser
    uint64_t first = 0;
    uint64_t last = 0;
    uint64_t stalled = 0;

    void add(const Row& row) {
        if (row.data.size() < BEAT) return;
        pending += static_cast<uint32_t>(row.data.size() / BEAT);
        rows.push_back(row);
    }

    template <typename Data> void drive(uint8_t& valid, Data& data, uint8_t& user, uint8_t& last) {
        if (idle > 0) {
            idle--;
            valid = 0;
            return;
        }
        valid = !rows.empty();
        if (!valid) return;
        const Row& row = rows.front();
        memcpy(&data, &row.data[next], BEAT);
        user = next == 0 && (row.flags & 1);
        last = is_last() && (row.flags & 2);
    }

    // The beat that was driven, if there was one, has been taken or not
    void done(bool valid, bool ready) {
        if (!valid) return;
        if (!ready) {
            stalled++;
            return;
        }
        pending--;
        if (next == 0 && (rows.front().flags & 1)) start = clocks;
        if (is_last()) {
            if (rows.front().flags & 4) {
                frames++;
                first = start;
                last = clocks;
            }
            idle = rows.front().idle;
            rows.pop_front();
            next = 0;
        } else {
            next += BEAT;
        }
    }

  private:
    enum { BEAT = 3 * PPC };

    bool is_last() const { return next + 2 * BEAT > rows.front().data.size(); }
};

static Serial serial;
static Camera cameras[2];
static uint32_t triggers;
static uint64_t last_trigger;
static uint32_t results;
static uint64_t last_results;

// An access to the IP is to go to nothing, after so many others.
static bool leads_astray;
static uint32_t right_accesses;

// What goes wrong within the SoC, from the next clock on. To be called when all is settled.
static void go_wrong() {
    if (dut.bitten) dut.hang = 0;
    if (dut.astray_done) dut.astray = 0;
    if (!leads_astray) return;
    if (dut.ip_done && right_accesses > 0) right_accesses--;
    if (right_accesses == 0 && (dut.ip_done || !dut.ip_request)) {
        leads_astray = false;
        dut.astray = 1;
    }
}

static void reset(uint32_t length) {
    dut.s_axis_1_tvalid = 0;
    dut.s_axis_2_tvalid = 0;
    dut.rst = 1;
    for (uint32_t i = 0; i < length; i++) tick();
    dut.rst = 0;
}

static void load() {
    const uint32_t count = get<uint32_t>();
    dut.rst = 1;
    dut.load_write = 1;
    for (uint32_t i = 0; i < count; i++) {
        dut.load_address = i;
        dut.load_data = get<uint32_t>();
        tick();
    }
    dut.load_write = 0;
    // Time begins with the reset, whatever the program's length
    clocks = 0;
    reset(4);
}

static void run(uint64_t length) {
    for (const uint64_t end = clocks + length; clocks < end;) {
        dut.uart_rx = serial.drive();
        cameras[0].drive(dut.s_axis_1_tvalid, dut.s_axis_1_tdata, dut.s_axis_1_tuser, dut.s_axis_1_tlast);
        cameras[1].drive(dut.s_axis_2_tvalid, dut.s_axis_2_tdata, dut.s_axis_2_tuser, dut.s_axis_2_tlast);
        const bool was_triggered = dut.trigger;
        settle();
        go_wrong();
        cameras[0].done(dut.s_axis_1_tvalid, dut.s_axis_1_tready);
        cameras[1].done(dut.s_axis_2_tvalid, dut.s_axis_2_tready);
        if (dut.results_done) {
            results++;
            last_results = clocks;
        }
        rise();
        serial.look(dut.uart_tx);
        if (dut.trigger && !was_triggered) {
            triggers++;
            last_trigger = clocks;
        }
    }
}

static void report() {
    put(clocks);
    put<uint8_t>(dut.lasers | dut.trigger << 1);
    put(triggers);
    put(last_trigger);
    put(results);
    put(last_results);
    for (const Camera& camera : cameras) {
        put(camera.frames);
        put(camera.first);
        put(camera.last);
        put(camera.pending);
        put(camera.stalled);
    }
    put(static_cast<uint32_t>(serial.to_send.size()));
    put(static_cast<uint32_t>(serial.received.size()));
    for (const Serial::Byte& byte : serial.received) {
        put(byte.byte);
        put(byte.clock);
    }
    serial.received.clear();
    fflush(stdout);
}

int main(int argc, char** argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s CLOCKS_PER_BIT\n", argv[0]);
        return 2;
    }
#if VM_TRACE
    Verilated::traceEverOn(true);
#endif
    serial.clocks_per_bit = static_cast<uint32_t>(atoi(argv[1]));
    dut.uart_rx = 1;
    dut.load_write = 0;
    for (;;) {
        switch (get<uint8_t>()) {
            case 'L':
                load();
                break;
            case 'Z':
                reset(get<uint32_t>());
                break;
            case 'U':
                for (uint8_t byte : get_bytes(get<uint32_t>())) serial.to_send.push_back(byte);
                break;
            case 'P': {
                const uint8_t camera = get<uint8_t>();
                const uint8_t flags = get<uint8_t>();
                const uint32_t idle = get<uint32_t>();
                cameras[camera & 1].add({flags, idle, get_bytes(get<uint32_t>())});
                break;
            }
            case 'T': {
                const uint64_t from = get<uint64_t>();
                const uint64_t length = get<uint64_t>();
                const std::vector<uint8_t> path = get_bytes(get<uint32_t>());
                trace(from, length, std::string(path.begin(), path.end()).c_str());
                break;
            }
            case 'C':
                dut.clocks_per_us = static_cast<uint16_t>(get<uint32_t>());
                break;
            case 'H':
                dut.hang = 1;
                break;
            case 'E':
                right_accesses = get<uint32_t>();
                leads_astray = true;
                break;
            case 'R':
                run(get<uint64_t>());
                report();
                break;
            default:
                fprintf(stderr, "unknown command\n");
                return 1;
        }
    }
}
