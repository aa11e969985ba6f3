// SPDX-License-Identifier: MIT OR Apache-2.0
//
// The block that `cargo xtask hw ml605` has wrapped, with the clock of the ML605 and two of its pins.

module ml605 (
  input  SYSCLK_P,   // 200 MHz
  input  SYSCLK_N,
  input  CPU_RESET,  // what goes through the block; not a reset
  output GPIO_LED_0  // what comes out
);
  wire pad, clk;
  reg [1:0] from_button;
  IBUFGDS clock_pad (.I(SYSCLK_P), .IB(SYSCLK_N), .O(pad));
  BUFG clock_tree (.I(pad), .O(clk));
  always @(posedge clk) from_button <= {from_button[0], CPU_RESET};
  wrapper wrapper_i (.clk(clk), .shift_in(from_button[1]), .shift_out(GPIO_LED_0));
endmodule
