# 1/t of a triangle at a pixel of a tile, in f32, where products and sums are rounded apart:
# PLANE_ROW and PLANE_AT. 1/t is W = T0 + TX x + TY y, and set-up rounds T0, TX and TY.
#
# A tile is traced in f32 where 4 |TX x| + 5 |TY y| is at most STEEPEST - 3 parts of W at all its
# pixels (src/plan/tiles/forms.rs). There the error is at most STEEPEST u of W. W is scaled to
# [1, 2], where a rounding costs most at 1, and $TX and $TY bound |TX| and |TY|.
#
# That set of TX and TY is covered by boxes; this is one of them.
@r = float<ieee_32, ne>;
T0 = W - TX * x - TY * y;
t0 = r(T0); tx = r(TX); ty = r(TY);
down = r(ty * y); row = r(t0 + down);
across = r(tx * x); w = r(row + across);
{ W in [1, 2] /\ |TX| <= $TX /\ |TY| <= $TY
  /\ |x| <= 32 /\ |y| <= 32 /\ @FIX(x, 0) /\ @FIX(y, 0)
  -> |w - W| <= $error }

# Row and W differ by what the column adds, so that row is no larger than W + X.
w - W -> (w - (row + across)) + (row - (t0 + down)) + (t0 - T0)
       + (down - ty * y) + (ty - TY) * y + (across - tx * x) + (tx - TX) * x;
row -> W - TX * x + (row - (t0 + down)) + (t0 - T0) + (down - ty * y) + (ty - TY) * y;
