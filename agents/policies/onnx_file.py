"""A policy as an ONNX file: the network with its normaliser and bounds, and the contract in the metadata.

The graph repeats the computation in NumPy: the normaliser in double precision, everything else in single.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rollingjoint
from agents.policies.base import PolicyNetwork
from agents.policies.cells import Cell, Gru
from agents.policies.contract import ACTION, MEMORY, NEXT_MEMORY, VECTOR, contract
from agents.policies.gain import GainNetwork
from agents.policies.layers import Layers
from agents.policies.network import CLIP, Network
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.shipped import ShippedPolicy
from agents.policies.stacked import StackedNetwork
from agents.runs.files import write_bytes
from rollingjoint.errors import naming_extras

with naming_extras():
    import onnx
    from onnx import TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 13, 8  # read by every runtime since 2021
KEY = "contract"  # in metadata_props
_ACTIVATIONS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


def write_onnx(policy: ShippedPolicy, path: Path) -> None:
    """Write the policy as an ONNX file, whole or not at all; the same bytes for the same policy."""
    write_bytes(path, onnx_model(policy).SerializeToString(deterministic=True))


def onnx_model(policy: ShippedPolicy) -> onnx.ModelProto:
    """The policy as an ONNX model with its contract as JSON under "contract" in metadata_props.

    Inputs: `observation` (batch, entries) float32, or the parts of a dictionary observation by name; with memory
    `memory` (batch, memory) float32, zeros where an episode begins. Outputs: `action` (batch, m) float32, and with
    memory `next_memory`, the input of the next step.
    """
    nodes = _Nodes()
    size = 0 if (start := policy.network.start(1)) is None else start.shape[1]
    action = _bounded(nodes, policy.network, _through_network(nodes, policy.network))
    nodes.add("Identity", [action], name=ACTION)
    sizes = dict(policy.network.inputs) or {VECTOR: policy.network.entries}
    inputs = [_vectors(name, count) for name, count in [*sizes.items(), *([(MEMORY, size)] if size else [])]]
    outputs = [_vectors(ACTION, len(policy.network.low)), *([_vectors(NEXT_MEMORY, size)] if size else [])]
    graph = helper.make_graph(nodes.nodes, policy.name, inputs, outputs, nodes.constants)
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, ir_version=IR_VERSION, opset_imports=opset)
    model.producer_name, model.producer_version = "rollingjoint", rollingjoint.__version__
    helper.set_model_props(model, {KEY: json.dumps(contract(policy), allow_nan=False)})
    onnx.checker.check_model(model, full_check=True)
    return model


class _Nodes:
    """The nodes and constants of a graph as it grows; values are known by name."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[TensorProto] = []

    def add(self, operator: str, inputs: list[str], name: str = "", **attributes: Any) -> str:
        """Add an operator; the name of its output."""
        return self.several(operator, inputs, [name or f"{operator.lower()}_{len(self.nodes)}"], **attributes)[0]

    def several(self, operator: str, inputs: list[str], names: list[str], **attributes: Any) -> list[str]:
        """Add an operator with several outputs; their names."""
        self.nodes.append(helper.make_node(operator, inputs, names, **attributes))
        return names

    def constant(self, name: str, array: NDArray[Any]) -> str:
        """Add a constant; its name."""
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def clipped(self, x: str, low: str, high: str) -> str:
        """Each entry of x within its bounds."""
        return self.add("Min", [self.add("Max", [x, low]), high])

    def linear(self, prefix: str, x: str, weights: NDArray[Any], biases: NDArray[Any]) -> str:
        """W x + b."""
        names = [self.constant(f"{prefix}weights", weights), self.constant(f"{prefix}biases", biases)]
        return self.add("Gemm", [x, *names], transB=1)


def _vectors(name: str, size: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])


def _through_network(nodes: _Nodes, network: PolicyNetwork) -> str:
    """The actions of the network before their bounds."""
    observation = nodes.add("Concat", list(network.inputs), axis=1) if network.inputs else VECTOR
    if isinstance(network, StackedNetwork):
        observation = _stacked(nodes, network)
    x = _normalised(nodes, network, observation)
    if not isinstance(network, RecurrentNetwork):
        y = _through(nodes, "", network.layers, network.activation, x)
        return _gained(nodes, network, y) if isinstance(network, GainNetwork) else y
    if network.encoder:
        encoded = _through(nodes, "encoder.", network.encoder, network.activation, x)
        x = nodes.add(_ACTIVATIONS[network.activation], [encoded])
    output = _through_cell(nodes, network.cell, x)
    head_input = nodes.add("Concat", [output, x], axis=1) if network.shortcut else output
    return _through(nodes, "", network.layers, network.activation, head_input)


def _stacked(nodes: _Nodes, network: StackedNetwork) -> str:
    """The observations of the memory and the newest one; all but the oldest become NEXT_MEMORY."""
    stacked = nodes.add("Concat", [MEMORY, VECTOR], axis=1)
    places = {"first": network.entries, "end": network.mean.size, "axis": 1}
    nodes.add("Slice", [stacked, *(nodes.constant(name, np.array([at])) for name, at in places.items())], NEXT_MEMORY)
    return stacked


def _gained(nodes: _Nodes, network: GainNetwork, y: str) -> str:
    """As GainForm.actions."""
    form, actions = network.error, len(network.low)
    d = len(form.places)
    entries = nodes.add("Gather", [VECTOR, nodes.constant("error_places", np.array(form.places))], axis=1)
    error = nodes.add("Mul", [entries, nodes.constant("error_unit", np.array([form.unit_mm], np.float32))])
    parts = nodes.constant("parts", np.array([actions * d, actions]))
    gains, offsets = nodes.several("Split", [y, parts], ["gains", "offsets"], axis=1)
    matrices = nodes.add("Reshape", [gains, nodes.constant("matrix_shape", np.array([0, -1, d]))])
    column = nodes.add("Reshape", [error, nodes.constant("column_shape", np.array([0, d, 1]))])
    product = nodes.add("Reshape", [nodes.add("MatMul", [matrices, column]), nodes.constant("row", np.array([0, -1]))])
    linear = nodes.add("Div", [product, nodes.constant("gain_mm", np.array([form.gain_mm], np.float32))])
    size = nodes.add("ReduceL2", [error], axes=[1], keepdims=1)
    scale = nodes.constant("scale_mm", np.array([form.scale_mm], np.float32))
    share = nodes.add("Div", [size, nodes.add("Add", [size, scale])])
    return nodes.add("Add", [linear, nodes.add("Mul", [offsets, share])])


def _normalised(nodes: _Nodes, network: PolicyNetwork, x: str) -> str:
    """clip((x - mean) / scale, -clip, clip) in double precision, as float32."""
    mean, scale = nodes.constant("mean", network.mean), nodes.constant("scale", network.scale)
    high, low = nodes.constant("clip", network.clip), nodes.constant("minus_clip", -network.clip)
    centred = nodes.add("Sub", [nodes.add("Cast", [x], to=TensorProto.DOUBLE), mean])
    return nodes.add("Cast", [nodes.clipped(nodes.add("Div", [centred, scale]), low, high)], to=TensorProto.FLOAT)


def _through(nodes: _Nodes, prefix: str, layers: Layers, activation: str, x: str) -> str:
    """The outputs of linear layers, with the activation between them, for the inputs x."""
    for i, (weights, biases) in enumerate(layers):
        if i:
            x = nodes.add(_ACTIVATIONS[activation], [x])
        x = nodes.linear(f"{prefix}{i}.", x, weights, biases)
    return x


def _through_cell(nodes: _Nodes, cell: Cell, x: str) -> str:
    """The output of the cell; its memory becomes NEXT_MEMORY."""
    return (_through_gru if isinstance(cell, Gru) else _through_lstm)(nodes, cell, x)


def _through_gru(nodes: _Nodes, cell: Cell, x: str) -> str:
    """As Gru.step."""
    inputs = nodes.linear("cell.input_", x, cell.input_weights, cell.input_biases)
    remembered = nodes.linear("cell.memory_", MEMORY, cell.memory_weights, cell.memory_biases)
    seen_r, seen_z, seen_n = _blocks(nodes, inputs, ["seen_r", "seen_z", "seen_n"], cell.width)
    old_r, old_z, old_n = _blocks(nodes, remembered, ["remembered_r", "remembered_z", "remembered_n"], cell.width)
    r = nodes.add("Sigmoid", [nodes.add("Add", [seen_r, old_r])])
    z = nodes.add("Sigmoid", [nodes.add("Add", [seen_z, old_z])])
    n = nodes.add("Tanh", [nodes.add("Add", [seen_n, nodes.add("Mul", [r, old_n])])])
    memory_share = nodes.add("Mul", [z, nodes.add("Sub", [MEMORY, n])])
    return nodes.add("Add", [n, memory_share], name=NEXT_MEMORY)


def _through_lstm(nodes: _Nodes, cell: Cell, x: str) -> str:
    """As Lstm.step; the memory is the output and the cell state side by side."""
    h, c = _blocks(nodes, MEMORY, ["h", "c"], cell.width)
    inputs = nodes.linear("cell.input_", x, cell.input_weights, cell.input_biases)
    remembered = nodes.linear("cell.memory_", h, cell.memory_weights, cell.memory_biases)
    i, f, g, o = _blocks(nodes, nodes.add("Add", [inputs, remembered]), ["i", "f", "g", "o"], cell.width)
    old_share = nodes.add("Mul", [nodes.add("Sigmoid", [f]), c])
    state = nodes.add("Add", [old_share, nodes.add("Mul", [nodes.add("Sigmoid", [i]), nodes.add("Tanh", [g])])])
    output = nodes.add("Mul", [nodes.add("Sigmoid", [o]), nodes.add("Tanh", [state])])
    nodes.add("Concat", [output, state], name=NEXT_MEMORY, axis=1)
    return output


def _blocks(nodes: _Nodes, x: str, names: list[str], width: int) -> list[str]:
    """Blocks of `width` columns of x."""
    sizes = f"widths_{names[0]}"
    return nodes.several("Split", [x, nodes.constant(sizes, np.full(len(names), width, np.int64))], names, axis=1)


def _bounded(nodes: _Nodes, network: PolicyNetwork, x: str) -> str:
    """The action within [low, high], by the output of the network."""
    low, high = nodes.constant("low", network.low), nodes.constant("high", network.high)
    output = network.output if isinstance(network, Network) else "clip"
    if output == "clip":
        return nodes.clipped(x, low, high)
    if output == "clipped tanh":
        bound = np.array([CLIP], np.float32)
        x = nodes.clipped(x, nodes.constant("minus_two", -bound), nodes.constant("two", bound))
    unit, half = np.ones(1, np.float32), np.float32(0.5) * (network.high - network.low)
    share = nodes.add("Add", [nodes.add("Tanh", [x]), nodes.constant("one", unit)])
    return nodes.add("Add", [low, nodes.add("Mul", [share, nodes.constant("half_range", half)])])
