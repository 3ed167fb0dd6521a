# 1/t of a triangle at a pixel of a tile, in f32, with fused multiply-adds: PLANE_ROW and
# PLANE_AT. 1/t is W = T0 + TX x + TY y, and set-up rounds T0, TX and TY.
#
# A tile is traced in f32 where 4 |TX x| + 5 |TY y| is at most STEEPEST - 3 parts of W at all its
# pixels (src/plan/tiles/forms.rs). There the error is at most STEEPEST u of W. W is scaled to
# [1, 2], where a rounding costs most at 1, and $TX and $TY bound |TX| and |TY|.
#
# That set of TX and TY is covered by boxes; this is one of them.
@r = float<ieee_32, ne>;
T0 = W - TX * x - TY * y;
t0 = r(T0); tx = r(TX); ty = r(TY);
row = r(t0 + ty * y);
w = r(row + tx * x);
{ W in [1, 2] /\ |TX| <= $TX /\ |TY| <= $TY
  /\ |x| <= 32 /\ |y| <= 32 /\ @FIX(x, 0) /\ @FIX(y, 0)
  -> |w - W| <= $error }

# Row and W differ by what the column adds, so that row is no larger than W + X.
w - W -> (w - (row + tx * x)) + (row - (t0 + ty * y)) + (t0 - T0)
       + (ty - TY) * y + (tx - TX) * x;
row -> W - TX * x + (row - (t0 + ty * y)) + (t0 - T0) + (ty - TY) * y;
