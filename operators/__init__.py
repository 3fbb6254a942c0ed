"""Blender operators; `CLASSES` in the order in which they are registered."""

from __future__ import annotations

from .add_preset import DGS_OT_add_preset
from .add_results import DGS_OT_add_results
from .batch import DGS_OT_batch, DGS_OT_cancel_batch, DGS_OT_take_set
from .cancel_job import DGS_OT_cancel_job
from .choose_photos import DGS_OT_choose_photos
from .compare_earlier import DGS_OT_compare_earlier
from .compare_truth import DGS_OT_compare_truth
from .composite_meshes import DGS_OT_composite_meshes
from .crop_twin import DGS_OT_crop_twin
from .dismiss import DGS_OT_dismiss
from .drop_files import DGS_FH_data_set, DGS_FH_photos, DGS_FH_twin
from .edit_splats import (
    DGS_OT_delete_splats,
    DGS_OT_edit_splats,
    DGS_OT_hide_splats,
    DGS_OT_restore_splats,
    DGS_OT_show_splats,
)
from .engine import DGS_OT_cancel_install, DGS_OT_check_engine, DGS_OT_install_engine, DGS_OT_open_preferences
from .estimate import DGS_OT_estimate
from .exact_view import DGS_OT_exact_view
from .export_twin import DGS_OT_export_twin
from .find_cameras import DGS_OT_find_cameras
from .give_back import DGS_OT_give_back
from .import_cameras import DGS_OT_import_cameras
from .import_twin import DGS_OT_import_twin
from .inspect_photos import DGS_OT_inspect_photos
from .limit_splats import DGS_OT_limit_splats
from .make_mesh import DGS_OT_make_mesh
from .make_test_set import DGS_OT_make_test_set
from .mark_assets import DGS_OT_mark_assets
from .measure import DGS_OT_measure, DGS_OT_measure_again
from .measure_psf import DGS_OT_measure_psf
from .measures import (
    DGS_OT_export_measures,
    DGS_OT_forget_length,
    DGS_OT_know_length,
    DGS_OT_remove_measure,
    DGS_OT_scale_by_board,
)
from .menus import DGS_MT_add, DGS_MT_object, DGS_MT_select, add_menus, remove_menus
from .merge_twins import DGS_OT_apply_transform, DGS_OT_merge_twins
from .open_manual import DGS_OT_open_manual
from .open_report import DGS_OT_open_report
from .optimize import DGS_OT_optimize
from .pause_job import DGS_OT_pause_job
from .place_twin import DGS_OT_set_length, DGS_OT_set_up
from .prepare_scene import DGS_OT_prepare_scene
from .remove_twin import DGS_OT_remove_twin
from .render_twin import DGS_OT_render_twin
from .resume_job import DGS_OT_resume_job
from .select_splats import (
    DGS_OT_select_by_colour,
    DGS_OT_select_by_error,
    DGS_OT_select_by_opacity,
    DGS_OT_select_by_size,
    DGS_OT_select_floaters,
)
from .show_cameras import DGS_OT_show_cameras
from .show_changes import DGS_OT_show_changes
from .show_known import DGS_OT_show_known
from .show_log import DGS_OT_show_log
from .show_next_views import DGS_OT_show_next_views
from .show_tradeoff import DGS_OT_show_tradeoff
from .split_view import DGS_GGT_split, DGS_GT_split, DGS_OT_split_view
from .suggest_next_views import DGS_OT_suggest_next_views
from .update_twin import DGS_OT_rollback_twin, DGS_OT_show_states, DGS_OT_update_twin
from .use_inspection import DGS_OT_use_inspection
from .view_twin import DGS_OT_view_twin

CLASSES: tuple[type, ...] = (
    DGS_OT_import_twin,
    DGS_OT_import_cameras,
    DGS_OT_export_twin,
    DGS_OT_prepare_scene,
    DGS_OT_choose_photos,
    DGS_OT_inspect_photos,
    DGS_OT_use_inspection,
    DGS_OT_measure_psf,
    DGS_OT_find_cameras,
    DGS_OT_show_cameras,
    DGS_OT_optimize,
    DGS_OT_resume_job,
    DGS_OT_pause_job,
    DGS_OT_cancel_job,
    DGS_OT_show_log,
    DGS_OT_add_results,
    DGS_OT_dismiss,
    DGS_OT_give_back,
    DGS_OT_view_twin,
    DGS_OT_exact_view,
    DGS_OT_split_view,
    DGS_OT_show_known,
    DGS_OT_show_next_views,
    DGS_OT_suggest_next_views,
    DGS_OT_set_length,
    DGS_OT_set_up,
    DGS_OT_crop_twin,
    DGS_OT_limit_splats,
    DGS_OT_edit_splats,
    DGS_OT_select_by_size,
    DGS_OT_select_by_opacity,
    DGS_OT_select_by_colour,
    DGS_OT_select_by_error,
    DGS_OT_select_floaters,
    DGS_OT_delete_splats,
    DGS_OT_hide_splats,
    DGS_OT_show_splats,
    DGS_OT_restore_splats,
    DGS_OT_merge_twins,
    DGS_OT_apply_transform,
    DGS_OT_mark_assets,
    DGS_OT_measure,
    DGS_OT_measure_again,
    DGS_OT_remove_measure,
    DGS_OT_know_length,
    DGS_OT_scale_by_board,
    DGS_OT_forget_length,
    DGS_OT_export_measures,
    DGS_OT_make_mesh,
    DGS_OT_compare_earlier,
    DGS_OT_show_changes,
    DGS_OT_add_preset,
    DGS_OT_batch,
    DGS_OT_cancel_batch,
    DGS_OT_take_set,
    DGS_OT_remove_twin,
    DGS_OT_render_twin,
    DGS_OT_composite_meshes,
    DGS_OT_open_report,
    DGS_OT_open_manual,
    DGS_OT_install_engine,
    DGS_OT_cancel_install,
    DGS_OT_check_engine,
    DGS_OT_open_preferences,
    DGS_FH_data_set,
    DGS_FH_photos,
    DGS_FH_twin,
    DGS_OT_estimate,
    DGS_OT_show_tradeoff,
    DGS_OT_make_test_set,
    DGS_OT_compare_truth,
    DGS_OT_update_twin,
    DGS_OT_rollback_twin,
    DGS_OT_show_states,
    DGS_MT_object,
    DGS_MT_add,
    DGS_MT_select,
)

#: What can be dragged in 3D views.
GIZMOS: tuple[type, ...] = (DGS_GT_split, DGS_GGT_split)

__all__ = ["CLASSES", "GIZMOS", "add_menus", "remove_menus"]
