r"""Products with the Jacobian of a recurrent policy, by full-length BPTT (section 2.4)."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from thesis_lib.policies.base import Linearised, Sequences
from thesis_lib.policies.linear_recurrence import LinearRecurrence
from thesis_lib.policies.recurrent import RecurrentPolicy


class RecurrentLinearised(Linearised):
    r"""A recurrent policy near the current parameters, by full-length BPTT (section 2.4).

    Notes
    -----
    A cell alternates the recurrent weights :math:`r_j = K u_j` with functions of each
    unit alone: :math:`u_1 = h` and, for an integrator with several stages,
    :math:`u_2(x, h, r_1)` and so on, up to the new state.  The gradient of the *sum* over
    units of such a function is therefore its slope at every unit.  One backward pass for
    each function, over all steps of the batch together, gives all slopes; from then on
    the network is a linear recurrence,

    .. math:: du_j = e_j + \sum_k \frac{\partial u_j}{\partial r_k} \circ K\,du_k
              + \frac{\partial u_j}{\partial h} \circ dh,

    whose sources :math:`e` (the parameters' direct effects) are products over the whole
    block.  :math:`Jv` runs it forward in time and :math:`J^\top u` runs its transpose
    backward, with nothing recomputed and no graph.
    """

    def __init__(self, policy: RecurrentPolicy, sequences: Sequences) -> None:
        self.policy = policy
        self.head = policy.head.weight.detach().clone()
        self.inputs = sequences.inputs
        self.packing = sequences.packing
        self.sizes = sequences.packing.sizes
        with torch.no_grad():
            drive = policy.input(self.inputs)
            start = policy.initial_state(self.packing.n_episodes)
            states = policy.unroll(drive, self.sizes, start)
            before = torch.cat([start, states[torch.as_tensor(self.packing.previous)]])
            self.hidden = states[:, : policy.units].contiguous()
            self.mean = policy.head(self.hidden)
        with torch.enable_grad():
            coefficients = policy.coefficients()
            self._find_coefficient_slopes(coefficients)
            self._find_slopes(drive, before, coefficients)

    def _find_coefficient_slopes(self, coefficients: tuple[Tensor, ...]) -> None:
        """Slope of each coefficient in each parameter, unit by unit."""
        parameters = self.policy.trainable()
        self.coefficient_slopes: list[dict[str, Tensor]] = []
        for c in coefficients:
            if not c.requires_grad:
                self.coefficient_slopes.append({})
                continue
            slopes = torch.autograd.grad(c.sum(), list(parameters.values()), allow_unused=True)
            named = zip(parameters, slopes, strict=True)
            self.coefficient_slopes.append({name: s for name, s in named if s is not None})

    def _find_slopes(self, drive: Tensor, before: Tensor, values: tuple[Tensor, ...]) -> None:
        """Slopes of every function of the cell in every argument, at every step."""
        policy = self.policy
        n_units = policy.units
        drive = drive.detach().requires_grad_()
        state = before.detach().requires_grad_()
        coefficients = [c.detach().expand(len(drive), -1).requires_grad_() for c in values]
        arguments: list[Tensor] = []
        results: list[Tensor] = []

        def recur(u: Tensor) -> Tensor:
            with torch.no_grad():
                r = functional.linear(u, policy.recurrent.weight)
            arguments.append(u)
            results.append(r.requires_grad_())
            return r

        after = policy.cell(drive, state, recur, *coefficients)
        if not torch.equal(arguments[0], before[:, :n_units]):
            raise ValueError(
                f"the cell of {type(policy).__name__} first applies its recurrent weights to "
                "something other than h; the first call of recur must be on h."
            )
        self.arguments = [u.detach().contiguous() for u in arguments]
        functions = [*arguments[1:], *after.split(n_units, dim=1)]
        leaves = [drive, state, *results, *coefficients]
        slopes = [
            torch.autograd.grad(f.sum(), leaves, retain_graph=True, allow_unused=True)
            for f in functions
        ]
        self.n_stages = len(results)
        places = {
            "drive": [0],
            "state": [1],
            "recurrent": list(range(2, 2 + self.n_stages)),
            "coefficient": list(range(2 + self.n_stages, len(leaves))),
        }
        self.slopes = {
            kind: [[_channels(row[i], n_units) for i in where] for row in slopes]
            for kind, where in places.items()
        }
        self.recurrence = LinearRecurrence(
            policy.recurrent.weight.detach().numpy().copy(),
            [
                [[(c, d.numpy()) for c, d in term] for term in row]
                for row in self.slopes["recurrent"]
            ],
            [[(c, d.numpy()) for c, d in row[0]] for row in self.slopes["state"]],
            self.sizes,
        )

    # ------------------------------------------------------------------------- J v
    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv`; see :meth:`Linearised.jvp`."""
        with torch.no_grad():
            d = self.policy.split(v)
            changes = self._sources(d)
            self.recurrence.forward(changes.numpy(), self._initial_change(d).numpy())
            hidden = changes[self.n_stages - 1]
            change = functional.linear(self.hidden, d["head.weight"], d["head.bias"])
            return change.addmm_(hidden, self.head.T)

    def _initial_change(self, d: dict[str, Tensor]) -> Tensor:
        """Change of the initial state, ``(P, B, N)``."""
        zero = torch.zeros_like(self.policy.h0)
        change = d.get("h0", zero).expand(self.packing.n_episodes, -1)
        return torch.stack(change.split(self.policy.units, dim=1))

    def _sources(self, d: dict[str, Tensor]) -> Tensor:
        """Direct effect of the parameters on every function of the cell, ``(F, R, N)``."""
        n = self.policy.units
        direct: dict[str, list[Tensor]] = {"drive": [], "recurrent": [], "coefficient": []}
        if "input.weight" in d:
            drive = functional.linear(self.inputs, d["input.weight"], d.get("input.bias"))
            direct["drive"] = [drive]
        if "recurrent.weight" in d:
            weight = d["recurrent.weight"]
            direct["recurrent"] = [functional.linear(u, weight) for u in self.arguments]
        direct["coefficient"] = self._coefficient_change(d)
        sources = []
        for i in range(len(self.slopes["state"])):
            source: Tensor | None = None
            for kind, changes in direct.items():
                for term, change in zip(self.slopes[kind][i], changes, strict=bool(changes)):
                    for c, slope in term:
                        part = change[..., c * n : (c + 1) * n]
                        if source is None:
                            source = slope * part
                        else:
                            source.addcmul_(slope, part)
            sources.append(torch.zeros_like(self.hidden) if source is None else source)
        return torch.stack(sources)

    def _coefficient_change(self, d: dict[str, Tensor]) -> list[Tensor]:
        """Change of each coefficient, shape ``(N,)``, by the chain rule."""
        zero = torch.zeros(self.policy.units, dtype=self.hidden.dtype)
        return [
            sum((slope * d[name] for name, slope in slopes.items()), zero)
            for slopes in self.coefficient_slopes
        ]

    # ----------------------------------------------------------------------- J^T u
    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u`; see :meth:`Linearised.vjp`."""
        with torch.no_grad():
            gradient = {
                "head.weight": u.T @ self.hidden,
                "head.bias": u.sum(0),
            }
            errors = self.hidden.new_zeros(len(self.slopes["state"]), *self.hidden.shape)
            errors[self.n_stages - 1] = u @ self.head
            results, first = self.recurrence.backward(errors.numpy())
            trainable = self.policy.trainable()
            if "recurrent.weight" in trainable:
                pairs = zip(results, self.arguments, strict=True)
                products = [torch.from_numpy(r).T @ a for r, a in pairs]
                gradient["recurrent.weight"] = torch.stack(products).sum(0)
            if "input.weight" in trainable:
                drive = self._drive_error(errors)
                gradient["input.weight"] = drive.T @ self.inputs
                if "input.bias" in trainable:
                    gradient["input.bias"] = drive.sum(0)
            if "h0" in trainable:
                gradient["h0"] = torch.cat([torch.from_numpy(s).sum(0) for s in first])
            self._add_coefficient_gradients(gradient, errors)
            return self.policy.join(gradient)

    def _drive_error(self, errors: Tensor) -> Tensor:
        """Error at the input's affine map, shape ``(R, gates * N)``."""
        n = self.policy.units
        total = torch.zeros((len(self.inputs), self.policy.gates * n), dtype=self.inputs.dtype)
        for row, error in zip(self.slopes["drive"], errors, strict=True):
            for c, slope in row[0]:
                total[:, c * n : (c + 1) * n].addcmul_(slope, error)
        return total

    def _add_coefficient_gradients(self, gradient: dict[str, Tensor], errors: Tensor) -> None:
        """Add what reaches the parameters through the coefficients of the units."""
        for i, slopes in enumerate(self.coefficient_slopes):
            if not slopes:
                continue
            total = torch.zeros(self.policy.units, dtype=self.hidden.dtype)
            for row, error in zip(self.slopes["coefficient"], errors, strict=True):
                for _, slope in row[i]:
                    total += (slope * error).sum(0)
            for name, slope in slopes.items():
                gradient[name] = gradient.get(name, 0) + slope * total


def _channels(slope: Tensor | None, n_units: int) -> list[tuple[int, Tensor]]:
    """Slopes channel by channel, without the channels that are 0 everywhere."""
    if slope is None:
        return []
    pieces = enumerate(slope.split(n_units, dim=1))
    return [(c, piece.contiguous()) for c, piece in pieces if bool(piece.any())]
