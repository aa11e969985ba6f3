-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- What the blocks of the reconstructor share.
--
-- Purpose     types, formats and latencies. Every latency is a function of the two generics that set it
-- Twin        karst_core: camera.rs, fusion.rs, reconstruct.rs

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

package reconstructor_pkg is

  -- Calibration words, in the formats of karst_core::CameraCalibration, LaserFrame and LaserCalibration
  type words_t is array (natural range <>) of signed(31 downto 0);

  -- Words of one camera: centre, inverse affine, decentring, polynomial, axial; the polynomials have G_TERMS words each
  constant CAMERA_CENTRE     : natural := 0;
  constant CAMERA_AFFINE     : natural := 2;
  constant CAMERA_DECENTRING : natural := 6;
  constant CAMERA_POLYNOMIAL : natural := 8;
  -- Words of one camera as seen from one laser: rotation row by row, viewpoint
  constant FRAME_ROTATION  : natural := 0;
  constant FRAME_VIEWPOINT : natural := 9;
  constant FRAME_WORDS     : natural := 12;
  -- Words of a beam's place in the rig: origin; axes along, up, across
  constant PLACE_ORIGIN : natural := 0;
  constant PLACE_AXES   : natural := 3;
  constant PLACE_WORDS  : natural := 12;
  -- Words of a beam's uncertainty: variance of the origin, low and high, and of the direction
  constant UNCERTAINTY_WORDS : natural := 4;

  -- karst_core::BeamRay, with the variance of its spot. All zero it is the beam itself
  type beam_ray_t is record
    up_slope         : signed(30 downto 0);  -- Q4.28, at most 2 in magnitude
    up               : signed(27 downto 0);  -- mm, Q.16
    across_slope     : signed(30 downto 0);  -- Q4.28, at most 2 in magnitude
    across           : signed(27 downto 0);  -- mm, Q.16
    slope_derivative : signed(16 downto 0);  -- by the normalised radius, Q.11
    start_derivative : signed(24 downto 0);  -- by the radius, mm per px, Q.10
    variance         : signed(24 downto 0);  -- of the spot, px**2, Q.24, 0 to 1
    inverse_radius   : signed(17 downto 0);  -- 1/px, Q.22, never negative
  end record;

  constant BEAM_RAY_WIDTH : positive := 203;

  function to_vector(ray : beam_ray_t) return signed;
  function to_beam_ray(vector : signed(BEAM_RAY_WIDTH - 1 downto 0)) return beam_ray_t;

  -- What became of a laser, or of a pair of its spots: a point, or karst_core::NoPoint in its order
  subtype outcome_t is unsigned(2 downto 0);
  constant POINT           : outcome_t := to_unsigned(0, 3);
  constant NO_SPOT         : outcome_t := to_unsigned(1, 3);
  constant ONE_CAMERA      : outcome_t := to_unsigned(2, 3);
  constant NO_INTERSECTION : outcome_t := to_unsigned(3, 3);
  constant OUT_OF_RANGE    : outcome_t := to_unsigned(4, 3);
  constant INCONSISTENT    : outcome_t := to_unsigned(5, 3);

  -- A distance along the beam that the formats hold, mm in Q.16: positive and below 8192 mm
  function in_reach(along : signed) return boolean;

  -- Whether value is at most 2 ** bits in magnitude
  function within(value : signed; bits : positive) return boolean;

  -- 2 ** (bits - 1): added to a product it rounds what is left when that many bits are cut off
  function half(bits, width : positive) return signed;

  -- Bits of the number of one of so many
  function index_bits(entries : positive) return positive;

  -- numerator / divisor, rounded up
  function ceil_divide(numerator, denominator : positive) return positive;

  -- Latencies of the math blocks
  function divide_latency(quotient_width, bits_per_stage : positive) return positive;
  function root_latency(root_width, bits_per_stage : positive) return positive;
  function reciprocal_latency(bits_per_stage : positive) return positive;
  function exact_reciprocal_latency(bits_per_stage : positive) return positive;

  -- Bits per stage where there is time: more cost more
  function few(bits_per_stage : positive) return positive;

  -- Latencies of the blocks of the reconstructor
  function camera_ray_latency(terms, bits_per_stage : positive) return positive;
  function beam_ray_latency(bits_per_stage : positive) return positive;
  function crossing_latency(bits_per_stage : positive) return positive;
  function fuse_gain_latency(bits_per_stage : positive) return positive;
  function fuse_plain_latency(bits_per_stage : positive) return positive;
  function fuse_across_latency(bits_per_stage : positive) return positive;
  function fuse_beam_latency(bits_per_stage : positive) return positive;
  function fuse_latency(bits_per_stage : positive) return positive;
  function average_latency(bits_per_stage : positive) return positive;
  constant TO_RIG_LATENCY : positive := 4;

end package;

package body reconstructor_pkg is

  function to_vector(ray : beam_ray_t) return signed is
  begin
    return ray.up_slope & ray.up & ray.across_slope & ray.across & ray.slope_derivative & ray.start_derivative
      & ray.variance & ray.inverse_radius;
  end function;

  function to_beam_ray(vector : signed(BEAM_RAY_WIDTH - 1 downto 0)) return beam_ray_t is
    variable ray : beam_ray_t;
  begin
    ray.up_slope         := vector(202 downto 172);
    ray.up               := vector(171 downto 144);
    ray.across_slope     := vector(143 downto 113);
    ray.across           := vector(112 downto 85);
    ray.slope_derivative := vector(84 downto 68);
    ray.start_derivative := vector(67 downto 43);
    ray.variance         := vector(42 downto 18);
    ray.inverse_radius   := vector(17 downto 0);
    return ray;
  end function;

  function in_reach(along : signed) return boolean is
  begin
    return along > 0 and along(along'high downto 29) = 0;
  end function;

  -- By slices: of a constant limit GHDL 2.0 may lose the bit, and the sign beyond 32 bits
  function within(value : signed; bits : positive) return boolean is
    alias v : signed(value'length - 1 downto 0) is value;
    variable high : signed(value'length - 1 - bits downto 0);
  begin
    high := v(v'high downto bits);
    return high = 0 or high = -1 or (high = 1 and v(bits - 1 downto 0) = 0);
  end function;

  function half(bits, width : positive) return signed is
  begin
    return shift_left(to_signed(1, width), bits - 1);
  end function;

  function index_bits(entries : positive) return positive is
    variable bits : positive := 1;
  begin
    while 2 ** bits < entries loop
      bits := bits + 1;
    end loop;
    return bits;
  end function;

  function ceil_divide(numerator, denominator : positive) return positive is
  begin
    return (numerator + denominator - 1) / denominator;
  end function;

  function divide_latency(quotient_width, bits_per_stage : positive) return positive is
  begin
    return ceil_divide(quotient_width + 1, bits_per_stage) + 2;
  end function;

  function root_latency(root_width, bits_per_stage : positive) return positive is
  begin
    return ceil_divide(root_width + 1, bits_per_stage) + 1;
  end function;

  function reciprocal_latency(bits_per_stage : positive) return positive is
  begin
    return 3 + ceil_divide(17, bits_per_stage);
  end function;

  function exact_reciprocal_latency(bits_per_stage : positive) return positive is
  begin
    return reciprocal_latency(bits_per_stage) + 5;
  end function;

  function few(bits_per_stage : positive) return positive is
  begin
    return minimum(bits_per_stage, 2);
  end function;

  function camera_ray_latency(terms, bits_per_stage : positive) return positive is
  begin
    return 14 + root_latency(32, few(bits_per_stage)) + 3 * (terms - 1);
  end function;

  function beam_ray_latency(bits_per_stage : positive) return positive is
  begin
    return 9 + exact_reciprocal_latency(bits_per_stage);
  end function;

  function crossing_latency(bits_per_stage : positive) return positive is
  begin
    return 3 + exact_reciprocal_latency(bits_per_stage);
  end function;

  function fuse_gain_latency(bits_per_stage : positive) return positive is
  begin
    return 16 + reciprocal_latency(bits_per_stage);
  end function;

  function fuse_plain_latency(bits_per_stage : positive) return positive is
  begin
    return fuse_gain_latency(bits_per_stage) + 10;
  end function;

  function fuse_across_latency(bits_per_stage : positive) return positive is
  begin
    -- The place across and its share of the beam, whichever comes later
    return maximum(fuse_gain_latency(bits_per_stage) + 11, 17 + 2 * reciprocal_latency(bits_per_stage));
  end function;

  function fuse_beam_latency(bits_per_stage : positive) return positive is
  begin
    return fuse_across_latency(bits_per_stage) + 2;
  end function;

  function fuse_latency(bits_per_stage : positive) return positive is
  begin
    return fuse_across_latency(bits_per_stage) + 8;
  end function;

  function average_latency(bits_per_stage : positive) return positive is
  begin
    return 1 + divide_latency(34, 2 * bits_per_stage);
  end function;

end package body;
