"""The training loop.

  pretrain:  clone the expert and warm the critics on demonstrations alone
  loop:      mature    measure S on the probe (eqs 2, 13)
             update    start gradient updates, alpha B of a batch's rows the expert's (eqs 3-6, 17)
             act       with the actor of before these updates, so both run at once
             record    reward terms, features and true successors
             report    metrics, evaluation, checkpoint

Everything random comes from one numpy generator, so a run of --steps that was killed or stopped resumes to the
same bytes.
"""

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from adrl.agents import budget, checkpoint
from adrl.agents.best import Best
from adrl.agents.config import TrainConfig
from adrl.agents.exploration import Explorer
from adrl.agents.interface import Evaluate, Progress, TrainEnv, TrainingStopped, TrainResult
from adrl.agents.learner import Learner
from adrl.agents.metrics import (
    METRICS_FILE,
    TENSORBOARD_FOLDER,
    EpisodeTally,
    MetricsLog,
    crossed,
    reward_row,
)
from adrl.agents.replay import Demonstrations
from adrl.agents.saved_run import SavedRun, identity, identity_of_before
from adrl.deploy.policy import MlpPolicy, PolicyConfig, load_policy
from adrl.errors import CheckpointError, ConfigError, FileError
from adrl.imitation.probe import Probe
from adrl.json_files import checked
from adrl.observation import Mirror
from adrl.rewards import reward
from adrl.rewards.step import step_discounts

F32 = NDArray[np.float32]


def train(
    config: TrainConfig,
    env: TrainEnv,
    out: Path,
    *,
    policy_config: PolicyConfig | None = None,
    demonstrations: Demonstrations | None = None,
    probe: Probe | None = None,
    mirror: Mirror | None = None,
    start: MlpPolicy | None = None,
    keep_best: bool = False,
    evaluate: Evaluate | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    start_time_s: float | None = None,
    resume: bool = False,
    stopped: Callable[[], bool] = lambda: False,
) -> TrainResult:
    """Train a policy and leave it in the run folder `out`.

    policy_config: what is saved with the policy (input_size, widths and maturity are filled in here).
    demonstrations: D2, for methods that imitate. probe: measures S, where the method follows it. mirror: of the
    observations of a symmetric robot. start: the actor to begin with. keep_best: it is validated first, and what is
    left in the end is the best of all that were validated. start_time_s: of time.monotonic(); wall clock and
    max_seconds count from it, validation left out but where it decides what is kept. resume: from the newest
    checkpoint, or from the start if there is none. stopped: whether to leave a checkpoint and end before the budget is
    spent, asked between steps. Raises ConfigError, also for a budget that ends before the first update; BudgetSpent for
    one that a finished run has had; TrainingStopped; CheckpointError, DatasetError.
    """
    budget.require_end(config)
    started_s = time.monotonic() if start_time_s is None else start_time_s
    rng = np.random.Generator(np.random.PCG64(config.seed))
    observation = np.array(env.reset(seed=config.seed)[0], dtype=np.float32)
    n, size = observation.shape
    learner = Learner(config, n, size, demonstrations, probe, rng, mirror, start)
    run = _Run(config, env, out, learner, rng, observation, policy_config, started_s)
    run.evaluate, run.on_progress = evaluate, on_progress
    run.start = start if keep_best else None
    try:
        run.begin(resume)
        while not (run.spent() or stopped()):
            if learner.pretraining:
                run.pretrain()
            else:
                run.iterate()
        if not run.spent():
            run.stop()
        return run.finish()
    finally:
        run.close()


class _Run:
    """The state of a run, and its verbs."""

    def __init__(
        self,
        config: TrainConfig,
        env: TrainEnv,
        out: Path,
        learner: Learner,
        rng: np.random.Generator,
        observation: F32,
        policy_config: PolicyConfig | None,
        started_s: float,
    ) -> None:
        self.config, self.env, self.out, self.learner = config, env, out, learner
        self.evaluate: Evaluate | None = None
        self.on_progress: Callable[[Progress], None] | None = None
        self.start: MlpPolicy | None = None
        self._best: Best | None = None
        self._last_validation_s = 0.0
        self._started_s, self._validation_s = started_s, 0.0
        self._rng, self._observation = rng, observation
        n, size = observation.shape
        base = policy_config or PolicyConfig(input_size=size, widths=config.td3.widths)
        self._policy_config = replace(base, input_size=size, widths=config.td3.widths)
        self._explorer = Explorer(config, n, learner.replay.longest_demonstration)
        self._tally = EpisodeTally.empty(n)
        self._returns: list[float] = []
        self._arrived: list[bool] = []
        self._env_steps, self._logged_at, self._validated_at = 0, 0, 0
        self._setup_s = 0.0
        self._train_success: float | None = None
        self._success: float | None = None
        self._log: MetricsLog | None = None

    def wall_s(self) -> float:
        """Seconds since the start, those before a resume included and those of validation left out."""
        return time.monotonic() - self._started_s - self._validation_s

    def spent(self) -> bool:
        """Whether a budget is used up."""
        return self._spent_fraction() >= 1.0

    def _spent_fraction(self) -> float:
        # A validation that decides comes after the last step, and is paid for.
        due_s = self._last_validation_s if self._best is not None else 0.0
        return budget.spent_fraction(self.config, self._env_steps, self.wall_s() + due_s)

    def begin(self, resume: bool) -> None:
        """Start afresh, or from the newest checkpoint."""
        self._setup_s = self.wall_s()
        found = checkpoint.load(self.out) if resume else None
        if found is not None:
            logged_bytes = self._restore(found)
            if self.spent() and self._policy_is_written():
                raise budget.spent(self.config, str(self.out), self._env_steps, self.wall_s())
            self._log = MetricsLog(self.out, logged_bytes, self._env_steps)
            return
        if checkpoint.exists(self.out):
            raise ConfigError(f"{self.out} holds a run; resume it, or give another folder")
        # What a run left that was killed before its first checkpoint.
        (self.out / METRICS_FILE).unlink(missing_ok=True)
        shutil.rmtree(self.out / TENSORBOARD_FOLDER, ignore_errors=True)
        self._log = MetricsLog(self.out)
        if self.start is not None:
            self._write_row(self._validate(self.start))

    def _policy_is_written(self) -> bool:
        """Whether the run folder has the policy of this state: a kill may have come after the last checkpoint."""
        try:
            return load_policy(self.out).config.extra.get("env_steps") == self._env_steps
        except CheckpointError:
            return False

    def pretrain(self) -> None:
        """Updates on demonstrations alone."""
        self._update()
        self.tell()

    def _update(self) -> None:
        if self.learner.compile_seconds is None:
            self.tell("compilation")
        self.learner.update()

    def iterate(self) -> None:
        """One step of all rows of the environment, and the updates that run beside it."""
        learner = self.learner
        acting = None if learner.acts_at_random else learner.acting(self._policy_config)
        learner.mature(self._returns, self._arrived)
        self.env.maturity = learner.maturity
        if self._env_steps >= self.config.start_steps and learner.replay.ready:
            self._update()
        length, periods = self._tally.length, self.env.periods
        self._step(self._explorer.act(acting, self._observation, length, periods, self._rng))
        self.tell()
        self._report()

    def _step(self, action: F32) -> None:
        periods = np.array(
            self.env.periods
        )  # of the robots that make this step: an episode's end may bring others
        observation, terminated, truncated, info = self.env.advance(action)
        terms, features, maturity = info["reward_terms"], info["features"], self.learner.reward_maturity
        self.learner.replay.add(
            *(self._observation, action, terms, features, info["next_obs"]),
            *(terminated, truncated, maturity, periods),
        )
        rewards = reward(terms, features, maturity, self.config.reward)
        ended, discount = terminated | truncated, step_discounts(self.config.td3.gamma, periods)
        returns = self._tally.add(rewards, ended, info["success"], discount)
        self._explorer.count(ended, info["success"])
        # The robots that explore least tell best what the actor itself would earn.
        telling = np.flatnonzero(ended) < max(len(ended) // 4, 1)
        self._returns, self._arrived = returns[telling].tolist(), info["success"][ended][telling].tolist()
        self._observation = np.array(observation, dtype=np.float32)
        self._env_steps += len(observation)

    def _due(self, interval_steps: int | None) -> bool:
        return crossed(self._env_steps, len(self._observation), interval_steps)

    def _report(self) -> None:
        evaluation_due = self.evaluate is not None and self._due(self.config.eval_interval_steps)
        if evaluation_due or self._due(self.config.log_interval_steps):
            self._write_row(self._validate_today() if evaluation_due else None)
        if self._due(self.config.checkpoint_interval_steps):
            self._save()

    def _validate_today(self) -> dict[str, float | None]:
        """Success of the averaged actor, and what the critic promised from the start states against what came."""
        return self._validate(self.learner.policy(self._policy_config))

    def _validate(self, policy: MlpPolicy) -> dict[str, float | None]:
        assert self.evaluate is not None
        self.tell("validation")
        began_s = time.monotonic()
        result = self.evaluate(policy, self.learner.reward_maturity)
        promised = self.learner.q_at(result.start)
        self._last_validation_s = time.monotonic() - began_s
        self._success, self._validated_at = result.success, self._env_steps
        if self.start is None:
            self._validation_s += self._last_validation_s
        elif self._best is None:
            self._best = Best.of(policy, result)
        else:
            self._best.offer(policy, self._env_steps, result)
        return {
            "success": result.success,
            "q_start": promised,
            "return_start": result.discounted_return,
            "overestimation": promised - result.discounted_return,
        }

    def _write_row(self, validated: dict[str, float | None] | None) -> None:
        numbers = validated or {"success": None}
        replay, n = self.learner.replay, len(self._observation)
        rows = max((self._env_steps - self._logged_at) // n, 1)
        recent = replay.newest(rows)
        tally = self._tally.take()
        self._train_success = tally["train_success"]
        head = {"wall_s": self.wall_s(), "env_steps": self._env_steps, "episode": self._tally.total}
        shaped = reward_row(*recent, self.learner.reward_maturity, self.config.reward) if replay.count else {}
        assert self._log is not None
        self._log.write(head | self.learner.row() | tally | numbers | shaped)
        self._logged_at = self._env_steps

    def tell(self, phase: str = "training") -> None:
        """Call the progress hook."""
        if self.on_progress is None:
            return
        learner = self.learner
        self.on_progress(
            Progress(
                phase=phase,
                fraction=self._spent_fraction(),
                wall_s=self.wall_s(),
                env_steps=self._env_steps,
                updates=learner.updates,
                episodes=self._tally.total,
                maturity=learner.maturity,
                alpha=learner.alpha,
                lambda_bc=learner.lambda_bc,
                train_success=self._train_success,
                success=self._success,
            )
        )

    def stop(self) -> NoReturn:
        """Save a checkpoint of a run that is not over."""
        self._save()
        raise TrainingStopped(
            f"stopped after {self._env_steps} environment steps; the same command with --resume goes on from there "
            f"({self.out})"
        )

    def finish(self) -> TrainResult:
        """Save the last checkpoint and the policy."""
        updates, episodes = self.learner.updates, self._tally.total
        budget.require_updates(self.config, updates, self._env_steps, self._setup_s)
        self.tell()
        seconds = self.wall_s()
        self._save()
        # After the checkpoint: a run that is resumed to go on writes no row here.
        validates = self.evaluate is not None and self.config.eval_interval_steps is not None
        unseen = validates and self._validated_at < self._env_steps
        # A run too short for a validation has one, and a log one row at the least.
        first = unseen and self._validated_at == 0
        if first or self._logged_at < self._env_steps or (unseen and self._best is not None):
            self._write_row(self._validate_today() if unseen else None)
            self.tell()
        counts = {
            "train_seconds": seconds,
            "env_steps": self._env_steps,
            "gradient_updates": updates,
            "episodes": episodes,
            "compile_seconds": self.learner.compile_seconds,
        }
        extra = dict(self._policy_config.extra) | counts
        about = replace(self._policy_config, extra=extra)
        policy = self.learner.policy(about) if self._best is None else self._best.policy_with(about)
        policy.save(self.out)
        return TrainResult(policy, self.out, self._env_steps, updates, episodes, seconds)

    def close(self) -> None:
        """Close the log."""
        if self._log is not None:
            self._log.close()

    def _save(self) -> None:
        assert self._log is not None
        state = {
            "config": identity(self.config, self._policy_config),
            "rng": self._rng.bit_generator.state,
            "learner": self.learner.numbers(),
            "tally": self._tally.state(),
            "env_steps": self._env_steps,
            "logged_at": self._logged_at,
            "validated_at": self._validated_at,
            "train_success": self._train_success,
            "success": self._success,
            "returns": self._returns,
            "arrived": self._arrived,
            "explorer": self._explorer.numbers(),
            "wall_s": self.wall_s(),
            "metrics_bytes": self._log.position(),
            **({} if self._best is None else {"best": self._best.numbers()}),
        }
        parts = {
            "learner": self.learner.arrays(),
            "replay": self.learner.replay.state(),
            "env": self.env.state(),
            "loop": {"observation": self._observation} | self._tally.arrays(),
            **({} if self._best is None else {"best": self._best.arrays()}),
        }
        checkpoint.save(self.out, self._env_steps, state, parts)

    def _restore(self, saved: checkpoint.Checkpoint) -> int:
        """Take its state; returns the length of the metrics log of then, in bytes."""
        try:
            state = checked(saved.state, SavedRun)
            today = identity(self.config, self._policy_config)
            replay = saved.part("replay")
            if "discount" not in replay:  # of before: gamma was that of a step of the only robot
                discount = float(step_discounts(self.config.td3.gamma, self.env.periods[:1])[0])
                today["td3"]["gamma"] = discount
                replay = replay | {"discount": np.full(replay["ending"].shape, discount)}
            checkpoint.require_same(saved.path, identity_of_before(state["config"]), today)
            self.learner.restore(saved.part("learner"), state["learner"])
            self.learner.replay.set_state(replay)
            self.env.set_state(saved.part("env"))
            loop = saved.part("loop")
            self._observation = loop.pop("observation")
            self._tally = EpisodeTally(**loop, **state["tally"])
            self._returns, self._arrived = state["returns"], state.get("arrived", [])
            self._explorer.restore(state.get("explorer", {}))
            if self.start is not None:
                self._best = Best.restored(state.get("best"), saved.part("best"), self._policy_config)
            self._rng.bit_generator.state = state["rng"]
            self._env_steps, self._logged_at = state["env_steps"], state["logged_at"]
            self._validated_at = state.get("validated_at", 0)
            self._train_success, self._success = state["train_success"], state["success"]
            self._started_s -= state["wall_s"]
            return state["metrics_bytes"]
        except CheckpointError as error:
            # What a part refuses does not know which checkpoint it came from.
            raise (
                error if str(self.out) in str(error) else CheckpointError(f"{saved.path}: {error}")
            ) from None
        except FileError as error:
            raise CheckpointError(
                f"{saved.path / checkpoint.STATE_FILE} {error}; delete the checkpoint"
            ) from None
        except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise CheckpointError(
                f"{saved.path}: not a checkpoint of this kind of run ({error!r})"
            ) from error
