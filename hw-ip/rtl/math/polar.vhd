-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Cartesian to polar coordinates by CORDIC vectoring, one result per clock.
--
-- Purpose     radius and angle (atan2, in turns) of a point; at the origin the angle means nothing
-- Method      eighteen shift-and-add rotations, one per stage. The directions of six rotations at a time address a table
--             with the sum of their angles: three additions instead of eighteen. Rotation i leaves y below 2 ** (1 - i)
--             of the radius, so y gets narrower from stage to stage
-- Latency     22: quarter turns 1, rotations 18, multiplication by 1 / gain 2, rounding 1
-- Throughput  one per clock, no stall
-- Resources   about 40 LUT per bit of G_BITS + 600, 2 to 4 DSP
-- Twin        karst_math::polar, for coordinates that need no clamping

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity polar is
  generic (
    G_BITS : positive range 8 to 17 := 17  -- coordinates are from -2 ** G_BITS to 2 ** G_BITS, both included
  );
  port (
    clk       : in  std_ulogic;                              -- rising edge
    rst       : in  std_ulogic;                              -- synchronous, high: forgets what is under way
    in_valid  : in  std_ulogic;                              -- coordinates are there
    x         : in  std_ulogic_vector(G_BITS + 1 downto 0);  -- signed, any one unit
    y         : in  std_ulogic_vector(G_BITS + 1 downto 0);  -- signed, the unit of x
    out_valid : out std_ulogic;                              -- radius and angle are there
    radius    : out std_ulogic_vector(G_BITS downto 0);      -- unsigned, the unit of x
    angle     : out std_ulogic_vector(15 downto 0)           -- from the x axis towards the y axis, 2 ** -16 turn
  );
end entity;

architecture rtl of polar is

  constant ROTATIONS : positive := 18;
  -- Fraction bits of x and y
  constant GUARD_BITS : positive := 12;
  -- 1 / (gain of 18 rotations), in units of 2 ** -20
  constant INVERSE_GAIN      : natural  := 636751;
  constant INVERSE_GAIN_BITS : positive := 20;
  constant RADIUS_SHIFT      : positive := INVERSE_GAIN_BITS + GUARD_BITS;

  -- Gain times diagonal is 2.33
  subtype x_t       is unsigned(G_BITS + GUARD_BITS + 1 downto 0);
  subtype y_t       is signed(G_BITS + GUARD_BITS + 1 downto 0);
  subtype angle_t   is unsigned(23 downto 0);  -- 2 ** -24 turn
  subtype product_t is unsigned(x_t'length + INVERSE_GAIN_BITS - 1 downto 0);

  type x_array_t     is array (natural range <>) of x_t;
  type y_array_t     is array (natural range <>) of y_t;
  type angle_array_t is array (natural range <>) of angle_t;

  type step_array_t is array (0 to ROTATIONS - 1) of natural;
  -- Rotation i is by atan(2 ** -i), in units of 2 ** -24 turn
  constant STEP : step_array_t := (
    2097152, 1238021, 654136, 332050, 166669, 83416, 41718, 20860, 10430, 5215, 2608, 1304, 652, 326, 163, 81, 41, 20
  );

  constant GROUP_SIZE : positive := 6;
  constant GROUPS     : positive := ROTATIONS / GROUP_SIZE;
  subtype table_t is angle_array_t(0 to 2 ** GROUP_SIZE - 1);

  -- Sum of the angles of a group. Bit i of the index tells that rotation i of the group was backwards
  function angles_of(group_index : natural) return table_t is
    variable table : table_t;
    variable sum   : integer;
  begin
    for index in table'range loop
      sum := 0;
      if group_index = 0 then
        sum := 128;  -- rounds the result to 2 ** -16 turn
      end if;
      for i in 0 to GROUP_SIZE - 1 loop
        if (index / 2 ** i) mod 2 = 1 then
          sum := sum - STEP(GROUP_SIZE * group_index + i);
        else
          sum := sum + STEP(GROUP_SIZE * group_index + i);
        end if;
      end loop;
      table(index) := unsigned(to_signed(sum, 24));
    end loop;
    return table;
  end function;

  -- Bits of y before rotation i, sign included: 2 ** -i of the largest x, times 4, and a sign
  function y_bits(i : natural) return positive is
  begin
    if i < 2 then
      return y_t'length;
    end if;
    return y_t'length + 2 - i;
  end function;

  -- Index i is the register before rotation i
  signal xs : x_array_t(0 to ROTATIONS);
  signal ys : y_array_t(0 to ROTATIONS);

  -- Element i: which of the rotations before rotation i were backwards
  type directions_array_t is array (0 to ROTATIONS) of std_ulogic_vector(ROTATIONS - 1 downto 0);
  signal directions : directions_array_t;

  -- Whether the point was turned by half a turn
  signal turned : std_ulogic_vector(0 to ROTATIONS + 1);

  signal angles     : angle_array_t(0 to GROUPS - 1);
  signal angle_low  : angle_t;
  signal angle_high : angle_t;

  signal product      : product_t;
  signal product_held : product_t;

  constant LATENCY : positive := ROTATIONS + 4;
  signal valid : std_ulogic_vector(1 to LATENCY);

begin

  valid_p : process (clk)
  begin
    if rising_edge(clk) then
      valid <= in_valid & valid(1 to LATENCY - 1);
      if rst = '1' then
        valid <= (others => '0');
      end if;
    end if;
  end process;

  -- CORDIC converges within a quarter turn of the x axis: the left half-plane is turned by half a turn
  quarter_turns_p : process (clk)
  begin
    if rising_edge(clk) then
      turned(0) <= x(x'high);
      if x(x'high) = '1' then
        xs(0) <= shift_left(resize(unsigned(-signed(x)), x_t'length), GUARD_BITS);
        ys(0) <= shift_left(resize(-signed(y), y_t'length), GUARD_BITS);
      else
        xs(0) <= shift_left(resize(unsigned(x), x_t'length), GUARD_BITS);
        ys(0) <= shift_left(resize(signed(y), y_t'length), GUARD_BITS);
      end if;
    end if;
  end process;

  directions(0) <= (others => '0');

  rotations_g : for i in 0 to ROTATIONS - 1 generate
    signal backward : std_ulogic;  -- y is negative
    signal shifted  : unsigned(x_t'range);  -- y / 2 ** i
    signal dx       : unsigned(x_t'range);
    signal dy       : unsigned(x_t'range);
    signal next_x   : unsigned(x_t'length downto 0);  -- the lowest bit only makes the borrow
    signal next_y   : unsigned(y_bits(i + 1) downto 0);
  begin

    backward <= ys(i)(y_t'high);
    -- Slices instead of shift_right: GHDL 2.0 converts that of a signed number into a logical shift
    shifted  <= unsigned(resize(ys(i)(y_t'high downto i), x_t'length));
    -- Always a subtraction, a + b = a - not b - 1: yosys then needs one LUT per bit, for an addition two
    dx       <= shifted when backward = '1' else not shifted;
    dy       <= shift_right(xs(i), i) when backward = '0' else not shift_right(xs(i), i);
    next_x   <= (xs(i) & '0') - (dx & not backward);
    next_y   <= (unsigned(ys(i)(y_bits(i + 1) - 1 downto 0)) & '0') - (dy(y_bits(i + 1) - 1 downto 0) & backward);

    rotate_p : process (clk)
    begin
      if rising_edge(clk) then
        xs(i + 1)            <= next_x(x_t'length downto 1);
        ys(i + 1)            <= resize(signed(next_y(y_bits(i + 1) downto 1)), y_t'length);
        directions(i + 1)    <= directions(i);
        directions(i + 1)(i) <= backward;
        turned(i + 1)        <= turned(i);
      end if;
    end process;

  end generate;

  groups_g : for i in 0 to GROUPS - 1 generate
    constant TABLE : table_t := angles_of(i);
  begin
    lookup_p : process (clk)
    begin
      if rising_edge(clk) then
        angles(i) <= TABLE(to_integer(unsigned(directions(ROTATIONS)(GROUP_SIZE * (i + 1) - 1 downto GROUP_SIZE * i))));
      end if;
    end process;
  end generate;

  results_p : process (clk)
    constant HALF : unsigned(product_t'range) := shift_left(to_unsigned(1, product_t'length), RADIUS_SHIFT - 1);
    variable rounded_radius : product_t;
    variable rounded_angle  : angle_t;
  begin
    if rising_edge(clk) then
      turned(ROTATIONS + 1) <= turned(ROTATIONS);
      angle_low  <= angles(0) + angles(1);
      angle_high <= angles(2) xor (turned(ROTATIONS + 1) & (22 downto 0 => '0'));
      rounded_angle := angle_low + angle_high;
      angle         <= std_ulogic_vector(rounded_angle(23 downto 8));

      product        <= xs(ROTATIONS) * to_unsigned(INVERSE_GAIN, INVERSE_GAIN_BITS);
      product_held   <= product;
      rounded_radius := product_held + HALF;
      radius         <= std_ulogic_vector(rounded_radius(RADIUS_SHIFT + G_BITS downto RADIUS_SHIFT));
    end if;
  end process;

  out_valid <= valid(LATENCY);

end architecture;
