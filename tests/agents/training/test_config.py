import inspect
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import rj_gym
from agents.runs.algorithms import PARAMETERS, constructor_arguments
from agents.runs.config import TrainConfig, load_config
from agents.runs.schedules import Linear
from agents.runs.seeds import TEST, TUNING, VALIDATION
from rollingjoint.chain.presets import PRESETS
from rollingjoint.errors import ConfigError

CONFIGS = sorted(Path("configs/train").glob("*.yaml"))


def write(folder: Path, text: str) -> Path:
    path = folder / "some.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_shipped_config_loads_and_survives_a_round_trip_through_yaml(path, tmp_path):
    config = load_config(path)
    again = load_config(write(tmp_path, yaml.safe_dump(config.to_dict())))
    assert again == config
    if config.env.id in rj_gym.IDS:
        assert config.env.settings["mechanism"] in PRESETS


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_runs_of_every_shipped_config_can_be_scored(path):
    """agents.results refuses runs that have seen the episodes of its tables, or those that choose the best."""
    assert set(load_config(path).evaluation.seeds).isdisjoint((*VALIDATION, *TEST, *TUNING))


def test_the_configs_named_in_the_documentation_exist():
    assert {path.stem for path in CONFIGS} >= {"demo", "ppo_rolling_joint", "sac_rolling_joint"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("total_timestep: 5", ["total_timestep", "'total_timesteps'"]),
        ("env: {n_env: 4}", ["env", "n_env", "'n_envs'"]),
        ("env: {settings: {episode_step: 4}}", ["env.settings", "episode_step", "'episode_steps'"]),
        ("env: {settings: {load: {magnitud: [0, 1]}}}", ["magnitud", "'magnitude'"]),
        ("parameters: {learning_rat: 0.1}", ["parameters", "learning_rat", "'learning_rate'"]),
        ("algorithm: sac\nparameters: {n_epochs: 3}", ["parameters", "n_epochs"]),
        ("algorithm: ppp", ["algorithm", "'ppp'", "'ppo'"]),
        ("total_timesteps: 0", ["total_timesteps = 0", "from 1 to"]),
        ("total_timesteps: 1.0e+30", ["total_timesteps = 1e+30", "from 1 to 1000000000000"]),
        ("evaluation: {episodes: 1000000000}", ["evaluation.episodes = 1000000000", "from 1 to 100000"]),
        ("env: {settings: {episode_steps: 1000000000}}", ["episode_steps = 1000000000", "from 1 to 100000"]),
        ("env: {settings: {target: {waypoints: 1000000000}}}", ["target.waypoints = 1000000000", "from 2 to 1000"]),
        ("parameters: {n_steps: 1000000000}", ["parameters.n_steps = 1000000000", "from 2 to 10000000"]),
        ("parameters: {n_steps: 10000000, batch_size: 16}", ["n_steps x n_envs = 160000000", "at most 10,000,000"]),
        ("parameters: {batch_size: 1000000000}", ["parameters.batch_size = 1000000000", "from 2 to 1000000"]),
        ("parameters: {n_epochs: 1000000000}", ["parameters.n_epochs = 1000000000", "from 1 to 1000000"]),
        ("algorithm: sac\nparameters: {buffer_size: 1000000000}", ["parameters.buffer_size", "from 1 to 10000000"]),
        ("algorithm: sac\nparameters: {n_steps: 1000000}", ["parameters.n_steps", "from 1 to 1000"]),
        (f"policy: {{hidden: {[64] * 17}}}", ["policy.hidden", "at most 16"]),
        ("total_timesteps: 1.5", ["total_timesteps", "integer"]),
        ("seed: true", ["seed = True", "integer"]),
        ("torch_threads: two", ["torch_threads", "'two'"]),
        ("normalise: {reward: 1}", ["normalise.reward", "true or false"]),
        ("policy: {hidden: 64}", ["policy.hidden", "list"]),
        ("policy: {hidden: [64, 0]}", ["policy.hidden", "from 1"]),
        ("policy: {activation: tan}", ["policy.activation", "'tanh'"]),
        ("parameters: {gamma: 1.1}", ["parameters.gamma = 1.1", "0 to 1"]),
        ("parameters: {gamma: .nan}", ["parameters.gamma", "finite"]),
        ("parameters: {learning_rate: -1}", ["parameters.learning_rate"]),
        ("parameters: {learning_rate: {linear: [1]}}", ["parameters.learning_rate.linear", "two numbers"]),
        ("parameters: {learning_rate: {cosine: [1, 0]}}", ["cosine", "linear"]),
        ("parameters: {learning_rate: 'lambda p: p'}", ["parameters.learning_rate", "finite number"]),
        ("parameters: {batch_size: 7}", ["parameters.batch_size = 7", "divisor of n_steps"]),
        ("algorithm: sac\nparameters: {ent_coef: auto_x}", ["parameters.ent_coef", "auto_X"]),
        ("algorithm: crossq\nparameters: {tau: 0.1}", ["parameters", "tau"]),
        ("algorithm: tqc\nparameters: {top_quantiles_to_drop_per_net: 25}", ["top_quantiles_to_drop_per_net", "24"]),
        ("policy: {value_hidden: [0]}", ["policy.value_hidden", "from 1"]),
        ("her: {}", ["her = 'ppo'", "sac, tqc"]),
        ("algorithm: crossq\nher: {}", ["her = 'crossq'", "sac, tqc"]),
        ("algorithm: sac\nher: {goal: 3}", ["her", "goal", "'goals'"]),
        ("algorithm: sac\nher: {strategy: past}", ["her.strategy", "future"]),
        ("algorithm: sac\nher: {}\nparameters: {n_steps: 3}", ["parameters.n_steps = 3", "1 with her"]),
        ("algorithm: sac\nher: {}", ["parameters.learning_starts = 100", ">= 800", "n_envs x episode_steps"]),
        (
            "algorithm: sac\nher: {}\nparameters: {learning_starts: 800, buffer_size: 1599}",
            ["parameters.buffer_size = 1599", ">= 1600"],
        ),
        ("evaluation: 5", ["evaluation = 5"]),
        ("- ppo", ["mapping"]),
        ("seed: 1\nseed: 2", ["seed", "twice"]),
        ("seed: [1", ["YAML"]),
        ("seed: !!python/object/apply:os.getpid []", ["YAML"]),
        ("env: {file: missing.yaml}", ["missing.yaml"]),
    ],
)
def test_a_wrong_config_names_the_file_the_key_and_the_mend(text, words, tmp_path):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    for word in [str(path), *words] if "missing" not in text else words:
        assert word in str(caught.value)


def test_a_missing_config_file_is_named():
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        load_config("nowhere.yaml")


def test_a_number_with_an_exponent_is_a_number(tmp_path):
    config = load_config(write(tmp_path, "parameters: {learning_rate: 3e-4, clip_range: {linear: [2e-1, 0]}}"))
    arguments = constructor_arguments(config.parameters)
    assert arguments["learning_rate"] == 3e-4
    assert arguments["clip_range"](0.5) == pytest.approx(0.1)


def test_an_integer_may_be_written_as_a_number_with_a_point(tmp_path):
    config = load_config(write(tmp_path, "total_timesteps: 1.5e3\nparameters: {batch_size: 64.0}"))
    assert (repr(config.total_timesteps), repr(config.parameters["batch_size"])) == ("1500", "64")


def test_a_linear_schedule_goes_from_start_to_end():
    schedule = Linear(3.0, 1.0)
    assert [schedule(1.0), schedule(0.5), schedule(0.0)] == [3.0, 2.0, 1.0]


def test_overrides_go_on_top_of_the_file_and_are_checked(tmp_path):
    path = write(tmp_path, "seed: 1\nenv: {settings: {load: {link: tip, process: ou}}}")
    config = load_config(path, ["seed=7", "env.settings.load.link=random", "parameters.gamma=0.5"])
    assert (config.seed, config.parameters["gamma"]) == (7, 0.5)
    assert config.env.settings["load"] == {"link": "random", "process": "ou"}
    for wrong in ("seed", "=3", "seed.x=1", "parameter.gamma=0.5", "seed=[1", "a..b=1"):
        with pytest.raises(ConfigError, match="--set"):
            load_config(path, [wrong])


def test_the_env_file_is_found_beside_the_config_and_settings_go_on_top(tmp_path):
    (tmp_path / "env.yaml").write_text("episode_steps: 20\nload: {link: tip, process: ou}")
    path = write(tmp_path, "env: {file: env.yaml, settings: {load: {link: random}}}")
    settings = load_config(path).env.settings
    assert settings == {"episode_steps": 20, "load": {"link": "random", "process": "ou"}}


def test_parameters_are_arguments_of_the_constructors():
    from agents.runs.algorithms import algorithm_class

    for name, parameters in PARAMETERS.items():
        accepted = inspect.signature(algorithm_class(name)).parameters
        assert set(parameters) <= set(accepted)


def test_hindsight_is_off_unless_the_configuration_names_it(tmp_path):
    learning = "algorithm: sac\nparameters: {learning_starts: 800}\n"
    assert load_config(write(tmp_path, learning)).her is None
    assert load_config(write(tmp_path, learning + "her: null")).her is None
    config = load_config(write(tmp_path, learning + "her: {strategy: final}"))
    assert (config.her.goals, config.her.strategy) == (4, "final")
    assert load_config(write(tmp_path, yaml.safe_dump(config.to_dict()))) == config


def test_the_default_config_is_valid():
    assert TrainConfig.from_dict({}) == TrainConfig()


@pytest.mark.slow
def test_importing_agents_and_reading_a_config_loads_neither_torch_nor_matplotlib():
    code = (
        "import sys, agents, agents.runs.config, agents.runs.folder, agents.train, agents.evaluate, agents.controllers;"
        "agents.runs.config.load_config('configs/train/demo.yaml');"
        "sys.exit(', '.join({'torch', 'stable_baselines3', 'matplotlib'} & set(sys.modules)) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_section_of_nothing_is_an_empty_one(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_text("parameters: null\nenv: null\n")
    config = load_config(path, ["parameters.gamma=0.9", "env.settings.episode_steps=20"])
    assert config.parameters == {"gamma": 0.9}
    assert config.env.settings == {"episode_steps": 20}
