// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives karst_top for crates/karst-cosim/src/top.rs. Commands come on standard input, an answer to each on standard
// output; all numbers low byte first. The file is compiled for PPC pixels per clock.
//
//   'Q' camera count, then count beats   to be sent after those before: u16 idle clocks before the beat, u8 flags (1: tuser,
//                                        2: tlast), 3 * PPC bytes of pixels
//   'S' input bus                        of 256 clocks, how many hold beats back, and bus channels
//   'C' camera count                     so many starts of frames more may be sent
//   'H' mask                             these cameras (bit 0: camera 1) send no new beats
//   'G' beats clocks                     goes on until so many beats are taken, at most so many clocks; with beats not 0 it
//                                        ends as well when no beat may be sent
//   'I' clocks                           goes on until the interrupt is up, at most so many clocks
//   'R' address, 'W' address value       a bus access
//
// camera and mask are u8, all other numbers u32. The answer: u32 value (what 'R' has read; beats not sent of both cameras
// together), u64 clock, u32 count, and count events: u8 kind (bit 0: camera 2, 1: first beat of a frame, 2: last beat of
// a row; 8: a point that is the last one of its frame; 16: the interrupt came up), u64 clock. Beats are told if they are a
// first or last one.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <vector>

#include "Vdut.h"
#include "Vdut___024root.h"
#include "verilated.h"

// Verilator takes interrupt for a word of C++

static uint64_t state = 88172645463325252u;

// xorshift64
static uint64_t random_bits() {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state >> 8;
}

static bool stalls(unsigned of_256) { return of_256 > 0 && (random_bits() & 255) < of_256; }

struct Beat {
    uint16_t gap;
    uint8_t flags;
    uint8_t data[3 * PPC];
};

struct Camera {
    std::deque<Beat> beats;
    uint64_t starts = 0;
    bool offered = false;
    unsigned waited = 0;

    bool may_send(bool held) const {
        return offered || (!held && !beats.empty() && (!(beats.front().flags & 1) || starts > 0));
    }
};

struct Event {
    uint8_t kind;
    uint64_t clock;
};

static Vdut dut;
static uint64_t clocks;
static Camera cameras[2];
static unsigned input_stalls, bus_stalls, held;
static std::vector<Event> events;
static uint64_t taken;
static bool interrupt_before;

static void get(void* to, size_t size) {
    if (size > 0 && fread(to, size, 1, stdin) != 1) exit(0);
}

static uint32_t get32() {
    uint32_t value;
    get(&value, sizeof value);
    return value;
}

static uint8_t get8() {
    uint8_t value;
    get(&value, sizeof value);
    return value;
}

// One clock; the bus signals are as they were set
static void tick() {
    bool offered[2];
    for (int c = 0; c < 2; c++) {
        Camera& camera = cameras[c];
        if (!camera.offered && camera.may_send(held >> c & 1)) {
            if (camera.waited < camera.beats.front().gap) {
                camera.waited++;
            } else if (!stalls(input_stalls)) {
                camera.offered = true;
                if (camera.beats.front().flags & 1) camera.starts--;
            }
        }
        offered[c] = camera.offered;
    }
    dut.s_axis_1_tvalid = offered[0];
    dut.s_axis_2_tvalid = offered[1];
    if (offered[0]) {
        const Beat& beat = cameras[0].beats.front();
        memcpy(&dut.s_axis_1_tdata, beat.data, sizeof beat.data);
        dut.s_axis_1_tuser = beat.flags & 1;
        dut.s_axis_1_tlast = beat.flags >> 1;
    }
    if (offered[1]) {
        const Beat& beat = cameras[1].beats.front();
        memcpy(&dut.s_axis_2_tdata, beat.data, sizeof beat.data);
        dut.s_axis_2_tuser = beat.flags & 1;
        dut.s_axis_2_tlast = beat.flags >> 1;
    }
    dut.eval();
    const bool take[2] = {offered[0] && dut.s_axis_1_tready, offered[1] && dut.s_axis_2_tready};
    for (int flag = 1; flag <= 2; flag++) {
        for (int c = 0; c < 2; c++) {
            if (take[c] && (cameras[c].beats.front().flags & flag)) {
                events.push_back({static_cast<uint8_t>(c | flag << 1), clocks});
            }
        }
    }
    for (int c = 0; c < 2; c++) {
        if (!take[c]) continue;
        cameras[c].beats.pop_front();
        cameras[c].offered = false;
        cameras[c].waited = 0;
        taken++;
    }
    if (dut.rootp->karst_top__DOT__point_valid && dut.rootp->karst_top__DOT__point_last) events.push_back({8, clocks});
    if (dut.__SYM__interrupt && !interrupt_before) events.push_back({16, clocks});
    interrupt_before = dut.__SYM__interrupt;
    dut.clk = 1;
    dut.eval();
    // Takes effect with what comes next
    dut.clk = 0;
    clocks++;
}

static uint32_t read_bus(uint32_t address) {
    dut.s_axi_araddr = address;
    bool sent = false;
    for (int left = 1000; left > 0; left--) {
        dut.s_axi_arvalid = !sent && (dut.s_axi_arvalid || !stalls(bus_stalls));
        dut.s_axi_rready = !stalls(bus_stalls);
        dut.eval();
        const bool goes = dut.s_axi_arvalid && dut.s_axi_arready;
        const bool comes = dut.s_axi_rvalid && dut.s_axi_rready;
        const uint32_t found = dut.s_axi_rdata;
        tick();
        sent = sent || goes;
        if (goes) dut.s_axi_arvalid = 0;
        if (comes) {
            dut.s_axi_rready = 0;
            return found;
        }
    }
    fprintf(stderr, "no answer to a read of %05x\n", address);
    exit(1);
}

static void write_bus(uint32_t address, uint32_t value) {
    dut.s_axi_awaddr = address;
    dut.s_axi_wdata = value;
    dut.s_axi_wstrb = 15;
    bool address_sent = false, data_sent = false;
    for (int left = 1000; left > 0; left--) {
        dut.s_axi_awvalid = !address_sent && (dut.s_axi_awvalid || !stalls(bus_stalls));
        dut.s_axi_wvalid = !data_sent && (dut.s_axi_wvalid || !stalls(bus_stalls));
        dut.s_axi_bready = !stalls(bus_stalls);
        dut.eval();
        const bool address_goes = dut.s_axi_awvalid && dut.s_axi_awready;
        const bool data_goes = dut.s_axi_wvalid && dut.s_axi_wready;
        const bool comes = dut.s_axi_bvalid && dut.s_axi_bready;
        tick();
        address_sent = address_sent || address_goes;
        data_sent = data_sent || data_goes;
        if (address_goes) dut.s_axi_awvalid = 0;
        if (data_goes) dut.s_axi_wvalid = 0;
        if (comes) {
            dut.s_axi_bready = 0;
            return;
        }
    }
    fprintf(stderr, "no answer to a write to %05x\n", address);
    exit(1);
}

static void answer(uint32_t value) {
    const uint32_t count = static_cast<uint32_t>(events.size());
    fwrite(&value, sizeof value, 1, stdout);
    fwrite(&clocks, sizeof clocks, 1, stdout);
    fwrite(&count, sizeof count, 1, stdout);
    for (const Event& event : events) {
        fwrite(&event.kind, sizeof event.kind, 1, stdout);
        fwrite(&event.clock, sizeof event.clock, 1, stdout);
    }
    fflush(stdout);
    events.clear();
}

static uint32_t beats_left() { return static_cast<uint32_t>(cameras[0].beats.size() + cameras[1].beats.size()); }

int main() {
    dut.clk = 0;
    dut.rst = 1;
    for (int i = 0; i < 4; i++) tick();
    dut.rst = 0;
    for (;;) {
        const uint8_t command = get8();
        uint32_t value = 0;
        if (command == 'Q') {
            Camera& camera = cameras[get8()];
            for (uint32_t count = get32(); count > 0; count--) {
                Beat beat;
                get(&beat.gap, sizeof beat.gap);
                beat.flags = get8();
                get(beat.data, sizeof beat.data);
                camera.beats.push_back(beat);
            }
        } else if (command == 'S') {
            input_stalls = get32();
            bus_stalls = get32();
        } else if (command == 'C') {
            Camera& camera = cameras[get8()];
            camera.starts += get32();
        } else if (command == 'H') {
            held = get8();
        } else if (command == 'G') {
            const uint64_t beats = get32();
            uint64_t left = get32();
            const uint64_t end = taken + beats;
            for (; left > 0; left--) {
                const bool flows = cameras[0].may_send(held & 1) || cameras[1].may_send(held >> 1 & 1);
                if (beats > 0 && (taken >= end || !flows)) break;
                tick();
            }
        } else if (command == 'I') {
            for (uint64_t left = get32(); left > 0 && !interrupt_before; left--) tick();
        } else if (command == 'R') {
            value = read_bus(get32());
        } else if (command == 'W') {
            const uint32_t address = get32();
            write_bus(address, get32());
        } else {
            fprintf(stderr, "unknown command %u\n", command);
            return 1;
        }
        answer(command == 'R' ? value : beats_left());
    }
}
