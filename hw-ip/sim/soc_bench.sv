// SPDX-License-Identifier: MIT OR Apache-2.0
//
// The SoC as soc_harness.cpp sees it: what it tells of its inside, and what can go wrong there.
//
// The SoC is the one that goes to a board. Only its conversion for this bench has places where a fault comes in.

module soc_bench #(
  parameter PPC = 1  // as G_PPC
) (
  input                 clk,            // as of soc
  input                 rst,
  input                 uart_rx,
  output                uart_tx,
  output                lasers,
  output                trigger,
  input                 s_axis_1_tvalid,
  output                s_axis_1_tready,
  input  [24*PPC-1:0]   s_axis_1_tdata,
  input                 s_axis_1_tuser,
  input                 s_axis_1_tlast,
  input                 s_axis_2_tvalid,
  output                s_axis_2_tready,
  input  [24*PPC-1:0]   s_axis_2_tdata,
  input                 s_axis_2_tuser,
  input                 s_axis_2_tlast,
  input                 load_write,
  input  [15:0]         load_address,
  input  [31:0]         load_data,

  output                results_done,   // the IP has made the results of a pair of frames ready
  output                bitten,         // the watchdog resets
  output                ip_request,     // an access of the processor to the IP
  output                ip_done,        // its acknowledgement
  output                astray_done,    // the acknowledgement of one that has gone astray

  // Faults, from the next clock on
  input                 hang,           // the IP never hears of an access
  input                 astray,         // an access to the IP goes to address 0, where nothing is
  input  [15:0]         clocks_per_us   // what a microsecond is taken for, clocks; 0: what the SoC was built for
);

  localparam [3:0] IP_REGION = 4'hc;  // the highest bits of its addresses

  reg        hang_now;
  reg        astray_now;
  reg [15:0] clocks_now;

  always @(posedge clk) begin
    hang_now   <= hang;
    astray_now <= astray;
    clocks_now <= clocks_per_us;
  end

  // What xtask's hw/faults.rs puts in front of signals of the converted SoC
  wire goes_astray = astray_now && soc_i.processor_i_dBusWishbone_ADR[29:26] == IP_REGION;
  wire is_fast     = clocks_now != 0;

  soc soc_i (.*);

  assign results_done = soc_i.karst_i.results_done;
  assign bitten       = soc_i.bitten;
  assign ip_request   = soc_i.karst_stb;
  assign ip_done      = soc_i.karst_ack;
  assign astray_done  = goes_astray && soc_i.d_ack;

endmodule
